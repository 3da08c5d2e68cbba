"""A still picture beside a widget, for the day when the kernel that drew it is gone.

A saved notebook keeps the name of a widget, not the widget: opened again, JupyterLab says "Error
displaying widget: model not found". With a still the picture is seen in its place, and what to do.
"""

from html import escape

from dancediff.motion.motion import Motion
from dancediff.viz.plots import plot_filmstrip
from dancediff.viz.style import as_png, data_url

MOMENTS, DPI = 5, 60  # of the picture of a dance: small, as it is stored with the notebook
NOTE = "A still picture: run this cell to move the controls."

# In JupyterLab only an output that has lost its widget has both classes.
_LOST = ".jp-OutputArea-output.jupyter-widgets"
_STYLE = f"""<style>
.jp-OutputArea-child:has(+ .jp-OutputArea-child {_LOST}) .dancediff-still
  {{ display: block !important; }}
.jp-OutputArea-child:has(.dancediff-still) + .jp-OutputArea-child:has({_LOST})
  {{ display: none !important; }}
</style>"""


def dance_png(motion: Motion, song=None) -> bytes:
    """Some moments of a dance as a small PNG."""
    import matplotlib.pyplot as plt

    figure = plot_filmstrip(motion, count=MOMENTS, song=song).figure
    png = as_png(figure, DPI)
    plt.close(figure)
    return png


def dance_html(motion: Motion) -> str:
    """What a notebook shows of a dance: some moments, and below them its one line."""
    line = escape(repr(motion))
    if not motion.joints().isfinite().all():
        return f"<code>{line}</code> with numbers that are not finite, which no picture shows"
    return f"{_image(dance_png(motion), line)}<br><code>{line}</code>"


def _image(png: bytes, words: str) -> str:
    return f'<img src="{data_url(png)}" alt="{words}" style="max-width:100%">'


def still_html(png: bytes) -> str:
    """A picture that shows itself only where the widget below it is gone.

    >>> "display:none" in still_html(b"png")
    True
    """
    inside = f"{_image(png, NOTE) if png else ''}<p><i>{NOTE}</i></p>"
    return f'{_STYLE}<div class="dancediff-still" style="display:none">{inside}</div>'


def show_with_still(widget, png: bytes):
    """Show a widget, and its still for later; the handle's ``update`` takes `as_output`'s."""
    from IPython.display import display

    handle = display(as_output(png), display_id=True)
    display(widget._repr_mimebundle_(), raw=True)
    return handle


def as_output(png: bytes):
    """The still as something that a notebook displays."""
    from IPython.display import HTML

    return HTML(still_html(png))
