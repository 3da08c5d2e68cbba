"""What all figures and pages share: small grey axes, a finding as the title, bytes for a page."""

import base64
import io

import numpy as np

from dancediff.atomic import atomic_write
from dancediff.music.librosa_import import import_librosa
from dancediff.viz.palette import GRID, INK, MUTED

MP3_RATES = (8000, 11025, 12000, 16000, 22050, 24000, 32000, 44100, 48000)  # the format has no more


def new_axes(ax=None, size=(7.0, 3.2)):
    """The axes given, or those of a new figure that belongs to no window."""
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.subplots(figsize=size, layout="constrained")[1]


def bare(ax, *, keep=("left", "bottom")):
    """Take the frame away and leave small grey labels."""
    for side, spine in ax.spines.items():
        spine.set_visible(side in keep)
        spine.set_color(GRID)
    ax.tick_params(which="both", colors=MUTED, labelsize=8)  # "both": a log axis has minor ticks
    ax.tick_params(length=3)
    ax.xaxis.label.set(color=MUTED, fontsize=9)
    ax.yaxis.label.set(color=MUTED, fontsize=9)
    return ax


def set_title(ax, title: str | None):
    """A finding, flush left above the picture; a "$" in it begins no formula."""
    if title:
        style = {"fontsize": 10, "color": INK, "fontweight": "bold"}
        ax.set_title(title, loc="left", parse_math=False, **style)
    return ax


def set_legend(ax, *of, **look):
    """A legend without a frame; a "$" in a name begins no formula."""
    legend = ax.legend(*of, **{"frameon": False, "fontsize": 8} | look)
    for text in legend.get_texts():
        text.set_parse_math(False)
    return legend


def as_png(figure, dpi: float | str = "figure") -> bytes:
    """A figure as the bytes of a PNG file."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=dpi)
    return file.getvalue()


def save_figure(figure, path, dpi: float | str = "figure") -> None:
    """Write a PNG file that appears whole or not at all, without matplotlib's version in it."""
    with atomic_write(path) as part:
        figure.savefig(part, format="png", dpi=dpi, metadata={"Software": None})


def data_url(content: bytes, kind: str = "image/png") -> str:
    """Bytes as an address that a page needs no file for.

    >>> data_url(b"png")
    'data:image/png;base64,cG5n'
    """
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"


def mp3(song, seconds: float) -> bytes:
    """The song as long as the dance: cut, or with silence at its end; it is the dance's clock."""
    import soundfile

    part = song.slice(0, min(seconds, song.duration))
    audio, rate = part.audio[:, :2], part.rate
    if rate not in MP3_RATES:
        audio = import_librosa().resample(audio, orig_sr=rate, target_sr=MP3_RATES[-1], axis=0)
        rate = MP3_RATES[-1]
    missing = max(round(seconds * rate) - len(audio), 0)
    sound = io.BytesIO()
    padded = np.pad(audio, ((0, missing), (0, 0)))
    # At a constant bit rate: in an MP3 of a variable one browsers jump to another place than they
    # say. Smaller files (a higher compression_level) have no room to say where the sound begins.
    options = {"bitrate_mode": "CONSTANT", "compression_level": 0.8 if rate >= 32000 else 0.6}
    soundfile.write(sound, padded, rate, format="MP3", **options)
    return sound.getvalue()
