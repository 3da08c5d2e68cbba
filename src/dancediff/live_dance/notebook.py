"""``dd.live``: a live dance in a notebook.

Read first: `dancediff.live_dance.server`.
"""

import time
from pathlib import Path

from dancediff.live_dance.server import LiveServer
from dancediff.live_dance.session import LiveSession
from dancediff.motion.motion import Motion
from dancediff.music.song import Music


class Live:
    """What `live` returns: shown in a notebook, it is the stage with its knobs."""

    def __init__(self, server: LiveServer, height: int):
        self.server, self.height = server, height

    @property
    def session(self) -> LiveSession:
        """The session, to be steered from cells: ``live.session.set(swap=(2, 1, 0))``."""
        return self.server.session

    def dance(self) -> tuple[Motion, Music]:
        """All that was danced so far, and its sound."""
        return self.session.dance()

    def save(self, out="live", formats=("npz", "mp4")) -> list[Path]:
        """Write what was danced so far; see `LiveSession.save`."""
        return self.session.save(out, list(formats))

    def stop(self) -> None:
        """End the dance; what was danced can still be saved."""
        self.server.stop()

    def _repr_html_(self) -> str:
        return (
            f'<iframe src="{self.server.address}" width="100%" height="{self.height}" '
            'allow="autoplay" style="border:0" title="a live dance"></iframe>'
        )

    def __repr__(self) -> str:
        return f"Live({self.server.address}, {self.session.song.name!r})"


def live(song, model="tcdiffpp", *, height: int = 620, out="live", **options) -> Live:
    """Dance to a song while it plays: the stage appears at once, and its knobs are obeyed.

    The dance begins before all of it is made; a bar shows how far ahead it is. "Save" writes it to
    the folder ``out``. The notebook's kernel must run on the computer of its browser.

    - ``song``: a `Music`, or the path of one.
    - ``model``: a name, a folder, or a pipeline of TCDiff++.
    - ``options``: those of `generate`, such as ``dancers=3``.

    Raises: ValueError as `generate`, and for a model that cannot be steered; ImportError naming
    the extra when tornado is not installed.
    """
    from dancediff import hub

    song = song if isinstance(song, Music) else Music.load(song)
    pipeline = hub.load(model) if isinstance(model, str | Path) else model

    def save(session: LiveSession) -> list[Path]:
        return session.save(Path(out) / time.strftime("%Y-%m-%d_%H-%M-%S"), ["npz", "html"])

    return Live(LiveServer(pipeline, song, save=save, **options).start(), height)
