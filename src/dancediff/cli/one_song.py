"""One dance to one song, written in all formats that are asked for.

Read first: `dancediff.generation.pipeline`.
"""

import contextlib
from collections.abc import Callable
from pathlib import Path

from dancediff.cli.files import file_of, save_dance, write_all
from dancediff.motion.motion import Motion


class Pieces:
    """Pieces of a dance, of which the last and the number of frames are remembered."""

    last: Motion

    def __init__(self, pieces):
        self.pieces, self.frames = pieces, 0

    def __iter__(self):
        for piece in self.pieces:
            self.last, self.frames = piece, self.frames + piece.num_frames
            yield piece


def dance_to(
    song, model, options: dict, formats: list[str], out: Path, finish: Callable | None = None
) -> tuple[dict, Motion]:
    """Dance and write: what is to be said of the dance, and a piece of it.

    ``options``: those of a request. ``finish(folder)`` is called before the files leave the hidden
    folder in which they are written.

    Raises: ValueError as `generate`; OSError naming what cannot be written.
    """
    from dancediff.io.pieces import save_pieces

    def finished(write: Callable) -> Callable:
        def both(folder: Path) -> None:
            write(folder)
            if finish is not None:
                finish(folder)

        return both

    if formats == ["npz"]:
        # nothing else is asked of the dance, so no more than a piece of it is held in memory
        with contextlib.closing(model.stream(song, **options)) as dancing:  # and its bar
            pieces = Pieces(dancing)
            files = write_all(out, finished(lambda to: save_pieces(pieces, to / file_of("npz"))))
    else:
        bar = bool(options.get("progress"))
        pieces = Pieces([model.generate(song, **options)])
        write = finished(lambda to: save_dance(to, formats, next(iter(pieces)), song, bar))
        files = write_all(out, write)
    dance = pieces.last
    facts = {"files": files, "dancers": dance.num_dancers, "frames": pieces.frames}
    return facts | dance.meta.get("whole", dance.meta), dance
