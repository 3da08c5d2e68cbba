"""``dd.live``: a live dance in a notebook.

Read first: `dancediff.live_dance.server`.
"""

import time
from pathlib import Path

from dancediff.live_dance.server import LiveServer
from dancediff.live_dance.session import LiveSession
from dancediff.motion.motion import Motion
from dancediff.music.live_song import LiveSong
from dancediff.music.song import Music, as_song
from dancediff.music.sound_sources import microphone as listen

RATE = 22050  # of a microphone
LISTENED = 600.0  # seconds that a microphone is danced to, unless others are asked for


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


def source_of(
    song, microphone: bool | int | str = False, seconds: float | None = None
) -> Music | LiveSong:
    """The song, or what a microphone hears from now on, for so many ``seconds``.

    Raises: ValueError unless there is one of both; as `sound_sources.microphone` and `LiveSong`.
    """
    asked = microphone is not False
    if asked == (song is not None):
        raise ValueError(
            f"song={song!r} and microphone={microphone!r}: give one of them to dance to"
        )
    if asked:
        device = None if microphone is True else microphone
        blocks = listen(RATE, device=device)
        seconds = LISTENED if seconds is None else seconds
        return LiveSong(blocks, RATE, seconds=seconds, name="microphone", keep=True)
    return as_song(song)


def live(
    song=None,
    model="tcdiffpp",
    *,
    microphone: bool | int | str = False,
    height: int = 620,
    out="live",
    **options,
) -> Live:
    """Dance to a song while it plays: the stage appears at once, and its knobs are obeyed.

    The dance begins before all of it is made; a bar shows how far ahead it is. "Save" writes it to
    the folder ``out``. The notebook's kernel must run on the computer of its browser.

    - ``song``: a `Music`, or the path of one; a `LiveSong` for sound from elsewhere.
    - ``microphone``: dance to what it hears, instead of a song; True, or a device's number or name.
    - ``model``: a name, a folder, or a pipeline of TCDiff++.
    - ``options``: those of `generate`, such as ``dancers=3``; with a microphone ``seconds`` are how
      long it is danced to, 600 by default.

    Raises: ValueError as `generate`, for a model that cannot be steered, and for a song beside a
    microphone or none without; ImportError naming the extra when tornado is not installed, or
    sounddevice for a microphone.
    """
    from dancediff import hub

    song = source_of(song, microphone, options.get("seconds"))
    pipeline = hub.load(model) if isinstance(model, str | Path) else model

    def save(session: LiveSession) -> list[Path]:
        return session.save(Path(out) / time.strftime("%Y-%m-%d_%H-%M-%S"), ["npz", "html"])

    return Live(LiveServer(pipeline, song, save=save, **options).start(), height)
