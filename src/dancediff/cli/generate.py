"""`dancediff generate`: its options are those of `dancediff.generation.request`.

Read first: `dancediff.generation.request` · `dancediff.generation.option`.
"""

import contextlib
from dataclasses import Field, dataclass, field, fields, make_dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import tyro

from dancediff.cli.files import (
    USUAL,
    check_folder,
    check_formats,
    check_targets,
    file_of,
    save_dance,
    song_named,
    tell,
    write_all,
)
from dancediff.generation.option import kinds_of
from dancediff.generation.presets import PRESETS
from dancediff.generation.request import REQUESTS, default_of

NOT_HERE = ("start", "end", "constraints")  # more than a word can say
WORDS = {bool: "True|False", int: "INT", float: "FLOAT", str: "STR", tuple[int, ...]: "INT INT ..."}
OTHER_TYPES: dict[str, Any] = {
    "swap": tuple[int, ...],
    "dtype": Literal["float32", "bfloat16", "fastest"],
    "device": str,
    "energy": str,
}


@dataclass
class _Generate:
    """What there is beside the options of a request."""

    song: tyro.conf.Positional[str]
    """A wav, flac, ogg or mp3 file; 'packaged' for the song that comes with dancediff."""
    model: str = "tcdiffpp"
    """A packaged model's name, or a model folder."""
    out: Path = Path("out")
    """Folder for the results."""
    formats: str = ",".join(USUAL)
    """Which files to write, of npz, mp4, png, html (a player), glb; bvh, smpl (one a dancer)."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Check what is cheap to check, dance, then write all files or none."""
        import torch

        from dancediff import hub
        from dancediff.io.pieces import save_pieces

        formats = check_formats(self.formats)
        check_folder(self.out)
        check_targets(self.out, formats)
        song = song_named(self.song)
        model = hub.load(self.model)
        options = {name: value for name in OPTIONS if (value := getattr(self, name)) is not None}
        options["dtype"] = getattr(torch, options.get("dtype", ""), options.get("dtype"))
        options["progress"] = not self.json
        if formats == ["npz"]:
            # nothing else is asked of the dance, so no more than a piece of it is held in memory
            with contextlib.closing(model.stream(song, **options)) as dancing:  # and its bar
                pieces = Counted(dancing)
                files = write_all(self.out, lambda to: save_pieces(pieces, to / file_of("npz")))
        else:
            pieces = Counted([model.generate(song, **options)])
            files = write_all(
                self.out, lambda to: save_dance(to, formats, next(iter(pieces)), song)
            )
        dance, frames = pieces.last, pieces.frames
        facts = {"files": files, "dancers": dance.num_dancers, "frames": frames}
        length = f"{frames / dance.fps:.1f} s"
        lines = [f"{dance.people}, {length}, to {song.name!r}:", *(f"  {file}" for file in files)]
        tell(self.json, facts | dance.meta, lines)


class Counted:
    """Pieces of a dance, of which the last and the number of frames are remembered."""

    def __init__(self, pieces):
        self.pieces, self.frames, self.last = pieces, 0, None

    def __iter__(self):
        for piece in self.pieces:
            self.last, self.frames = piece, self.frames + piece.num_frames
            yield piece


def _option(one: Field) -> tuple[str, Any, Any]:
    """A field of the command: None unless it is given, so that the preset can decide."""
    kind = OTHER_TYPES.get(one.name)
    if choices := one.metadata["choices"]:
        kind = Literal[choices]
    kind = kind or next(kind for kind in (bool, int, float, str) if kind in kinds_of(one))
    of = WORDS.get(kind) or "|".join(map(str, get_args(kind)))
    shown = tyro.conf.arg(
        help=one.metadata["help"], metavar=of, help_behavior_hint=_defaults(one.name)
    )
    return one.name, Annotated[kind | None, shown], field(default=None)


def _defaults(name: str) -> str:
    """Which models have an option, and its defaults.

    >>> _defaults("steps")
    '(default: tcdiffpp 12, lodge 20, edge 20; paper: 50)'
    >>> _defaults("soft")
    '(lodge; default: 1.0)'
    """
    families = [family for family, request in REQUESTS.items() if name in request.names()]
    words = [", ".join(families)] if len(families) < len(REQUESTS) else []
    for preset in PRESETS:
        values = {family: default_of(family, name, preset) for family in families}
        shown = dict.fromkeys(str(value) for value in values.values())
        text = ", ".join(f"{family} {v}" for family, v in values.items() if v is not None)
        text = next(iter(shown)) if len(shown) == 1 else text
        if text != "None" and not (words and words[-1].endswith(f": {text}")):
            words.append(f"{'default' if preset == 'packaged' else preset}: {text}")
    return f"({'; '.join(words)})" if words else ""


_FIELDS = {one.name: one for request in REQUESTS.values() for one in fields(request)}
OPTIONS = [name for name in _FIELDS if name not in NOT_HERE]
Generate = make_dataclass("Generate", [_option(_FIELDS[n]) for n in OPTIONS], bases=(_Generate,))
Generate.__doc__ = "Make a group dance to a song."
