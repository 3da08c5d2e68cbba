"""Sliders around a panel, with a progress bar, Cancel and A/B comparison for panels that dance.

Read first: `dancediff.viz.panels`, whose sliders it shows.

A panel is a function from numbers to a Figure, or to a Figure, the `Motion` it shows and, where
there is one, the `Music`. One that takes ``report`` is slow: it runs in a thread, once its button
is pressed, calls ``report(done, total)`` as it goes, and is stopped there when somebody cancels.
"""

import inspect
import threading
from html import escape

from dancediff.threads import Worker
from dancediff.viz.still import as_output, show_with_still
from dancediff.viz.style import as_png

_WIDE = {"max_width": "100%", "align_self": "flex-start"}  # else a picture is blown up


class Cancelled(Exception):
    """Raised out of ``report`` once Cancel was pressed or a newer request has come."""


class Explorer:
    """What `dancediff.viz.panels.explore` returns: controls, buttons, and what the panel drew.

    ``box`` is the widget that a notebook shows.
    """

    def __init__(self, panel, controls: dict):
        import ipywidgets as widgets

        self.panel, self.controls = panel, controls
        self.slow = "report" in inspect.signature(panel).parameters
        self.dance = self.dance_a = self.song = self._still = None
        self._first = {name: control.value for name, control in controls.items()}
        self._newest, self._busy = 0, threading.Lock()
        self._thread: Worker | None = None

        self.run = _button("Dance", "play", self.draw)
        self.reset = _button("Reset", "undo", self._reset)
        self.pin = _button("Pin as A", "thumb-tack", self._pin, disabled=True)
        self.watch = _button("Watch", "eye", self._watch, disabled=True)
        self.cancel = _button("Cancel", "stop", self._cancel)
        self.bar = widgets.IntProgress(layout={"width": "300px"})
        self.message = widgets.HTML()
        self.pinned = widgets.Image(format="png", layout=_WIDE | {"display": "none"})
        self.picture = widgets.Image(format="png", layout=_WIDE | {"display": "none"})
        self.stage = widgets.VBox()
        _align(controls.values())
        _show(False, self.cancel, self.bar, self.watch)
        _show(self.slow, self.run)

        buttons = widgets.HBox(
            [self.run, self.reset, self.pin, self.watch, self.bar, self.cancel],
            layout={"flex_flow": "row wrap"},
        )
        shown = [getattr(control, "box", control) for control in controls.values()]
        self.box = widgets.VBox(
            [*shown, buttons, self.message, self.picture, self.pinned, self.stage]
        )
        for control in controls.values():
            control.observe(self._changed, names="value")
        if not self.slow:
            self.draw()

    def _ipython_display_(self) -> None:
        self._still = show_with_still(self.box, self.picture.value)

    def values(self) -> dict:
        """What the controls say now, by name."""
        return {name: control.value for name, control in self.controls.items()}

    def draw(self, *_) -> None:
        """Run the panel; a slow one in a thread, after the one that still runs has stopped."""
        self._newest += 1
        if self.slow:
            self._thread = Worker(self._work, self._newest, stop=self._forget).begin()
        else:
            self._attempt(self._newest)

    def wait(self) -> None:
        """Until the newest request is done, cancelled or has failed."""
        if self._thread is not None:
            self._thread.join()

    def _changed(self, _) -> None:
        if not self.slow or self.picture.value:  # a slow one starts when it is asked to
            self.draw()

    def _work(self, request: int) -> None:
        with self._busy:
            if request != self._newest:
                return
            self.message.value = ""
            self.bar.value, self.bar.max = 0, 1
            _show(True, self.cancel, self.bar)
            self._attempt(request, report=self._reporter(request))
            _show(False, self.cancel, self.bar)

    def _reporter(self, request: int):
        def report(done: int, total: int) -> None:
            if request != self._newest:
                raise Cancelled
            self.bar.max, self.bar.value = total, done

        return report

    def _attempt(self, request: int, **more) -> None:
        try:
            made = self.panel(**self.values(), **more)
        except Cancelled:
            pass  # who cancelled has said so
        except Exception as err:
            self.message.value = f"<pre>{type(err).__name__}: {escape(str(err))}</pre>"
        else:
            if request == self._newest:
                self._take(made)

    def _take(self, made) -> None:
        made = made if isinstance(made, tuple) else (made,)
        figure, self.dance, self.song = (*made, None, None)[:3]
        self.picture.value, self.message.value = as_png(figure), ""
        if self._still is not None:
            self._still.update(as_output(self.picture.value))
        _show(True, self.picture)  # an image without a picture is shown as a broken one
        self.pin.disabled = False
        self.watch.disabled = self.dance is None
        _show(self.dance is not None, self.watch)

    def _cancel(self, _) -> None:
        self._forget()
        self.message.value = "cancelled"

    def _forget(self) -> None:
        self._newest += 1  # so nobody asks for what is being made

    def _reset(self, _) -> None:
        for control in self.controls.values():
            control.unobserve(self._changed, names="value")
        for name, control in self.controls.items():
            control.value = self._first[name]
            control.observe(self._changed, names="value")
        self._changed(None)

    def _pin(self, _) -> None:
        """Keep what is shown now as A below what comes, or let it go again."""
        keep = self.pin.description == "Pin as A"
        self.pinned.value = self.picture.value if keep else b""
        self.dance_a = self.dance if keep else None
        self.pin.description = "Unpin A" if keep else "Pin as A"
        self.pinned.layout.display = "" if keep else "none"

    def _watch(self, _) -> None:
        """The dance on a stage; beside it A, if one is pinned, with the same clock."""
        from dancediff.viz.stage import stage

        a, b = self.dance_a, self.dance
        assert b is not None  # the button is shown with a dance only
        shown = stage(b, self.song) if a is None or a is b else stage(a, self.song, beside=b)
        self.stage.children = (shown,)


def _button(text: str, icon: str, on_click, *, disabled: bool = False):
    import ipywidgets as widgets

    button = widgets.Button(
        description=text, icon=icon, disabled=disabled, layout={"width": "110px"}
    )
    button.on_click(on_click)
    return button


def _align(controls) -> None:
    """Give all labels the width of the longest, so that sliders begin below each other."""
    named = [one for one in controls if getattr(one, "description", "")]
    wide = max((7 * len(one.description) + 16 for one in named), default=0)
    for one in named:
        one.style.description_width = f"{wide}px"
        one.layout.width = f"{wide + (350 if hasattr(one, 'readout') else 180)}px"


def _show(shown: bool, *parts) -> None:
    for part in parts:
        part.layout.display = "" if shown else "none"
