"""One page that plays a dance with its song: opens from disk, needs no network, no kernel.

Read first: docs/export.md · `dancediff.motion.motion`.

The page's own code is ``assets/player/player.js``, bundled with three.js (`make player`). Here the
dance is packed into it: rotations as 16-bit quaternions (turned by at most 0.01 degrees), roots as
32-bit metres, the song as MP3.
"""

import base64
import json
import math
from pathlib import Path

import numpy as np

from dancediff.atomic import write_text
from dancediff.axes import ON_FLOOR
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24, Skeleton
from dancediff.viz.mannequin import EGGS, FACE, SKULL, TUBES, steady_quaternions
from dancediff.viz.palette import BEAT, FLOOR, GRID, MUTED, WALL, dancer_color
from dancediff.viz.style import data_url, mp3

PAGE = Path(__file__).parents[1] / "assets" / "player"
SHOWN = ("TIF", "BAS", "MMC", "PFC", "FSR", "joint speed")  # metrics that need no reference set


def save_player(
    motion: Motion,
    path,
    song=None,
    *,
    other: Motion | None = None,
    metrics: bool = True,
) -> Path:
    """Write a dance as one .html page; with ``other`` two dances side by side, played together.

    ``metrics``: below each dance, those of `dancediff.evaluate` that need no reference set. The
    file appears whole or not at all.

    Raises: ValueError when the two dances differ in length or frame rate, or a skeleton is not
    SMPL-24.
    """
    path, motions = Path(path), [motion] if other is None else [motion, other]
    titles = ("",) if other is None else ("A", "B")
    before, after = player_page()
    text = as_data(player_facts(motions, song, titles=titles, metrics=metrics))
    write_text(path, before + text + after)
    return path


def player_facts(motions: list[Motion], song=None, *, titles, metrics: bool) -> dict:
    """What the page is told of one dance, or of two that play together, each under its title.

    Raises: ValueError as `save_player`.
    """
    if any(shown.skeleton.names != SMPL24.names for shown in motions):
        raise ValueError(
            "the page shows SMPL-24 bodies; this skeleton is another one, see "
            "dancediff.data.retarget"
        )
    first, other = motions[0], motions[-1]
    for name in ("num_frames", "fps"):
        if getattr(first, name) != getattr(other, name):
            raise ValueError(
                f"other has {name}={getattr(other, name)}, the dance {getattr(first, name)}; they "
                "play together, so cut or resample one of them first"
            )
    panes = [
        _pane(dance, title, _numbers(dance, song) if metrics else [])
        for dance, title in zip(motions, titles, strict=True)
    ]
    return _facts(motions, song) | {"panes": panes}


def player_page() -> tuple[str, str]:
    """The page in two parts; between them belongs what it is told, as `as_data` writes it."""
    page = (PAGE / "page.html").read_text(encoding="utf-8")
    code = (PAGE / "player.min.js").read_text(encoding="utf-8")
    top, bottom = page.split("{{PLAYER}}")
    before, after = top.split("{{DATA}}")
    return before, after + code + bottom


def as_data(facts) -> str:
    """JSON that can stand in a page: no tag can begin in it.

    >>> as_data({"title": "</script>"})
    '{"title":"\\\\u003c/script>"}'
    """
    return json.dumps(facts, separators=(",", ":")).replace("<", "\\u003c")


def _facts(motions: list[Motion], song) -> dict:
    """What all panes share: length, beats, sound, the body, and where the floor lies."""
    motion = motions[0]
    floor = np.concatenate([m.root.numpy().reshape(-1, 3)[:, ON_FLOOR] for m in motions])
    low, high = floor.min(0), floor.max(0)
    beats = [] if song is None else song.beats()
    title = motion.people if song is None else f"{song.name} · {motion.people}"
    return shared_facts(motion.skeleton, title, frames=motion.num_frames, fps=motion.fps) | {
        "beats": [round(float(b), 3) for b in beats if b < motion.duration],
        "song": None if song is None else data_url(mp3(song, motion.duration), "audio/mpeg"),
        "centre": ((low + high) / 2).round().tolist(),
        "side": 2 * math.ceil((high - low).max() / 2 + 2),
    }


def shared_facts(skeleton: Skeleton, title: str, *, frames: int, fps: float) -> dict:
    """What a page knows without a dance: its title and length, the body, the colours."""
    return {
        "title": title,
        "fps": fps,
        "frames": frames,
        "beats": [],
        "body": {
            "names": skeleton.names,
            "parents": skeleton.parents,
            "offsets": skeleton.offsets.double().numpy().round(5).tolist(),
            "eggs": EGGS,
            "tubes": TUBES,
            "skull": SKULL,
            "face": FACE,
        },
        "colors": {"wall": WALL, "floor": FLOOR, "grid": GRID, "muted": MUTED, "beat": BEAT},
    }


def _pane(motion: Motion, title: str, numbers: list) -> dict:
    colors = [dancer_color(k) for k in range(motion.num_dancers)]
    return {"title": title, "metrics": numbers, "colors": colors} | packed(motion)


def packed(motion: Motion) -> dict:
    """Rotations, roots and foot contacts as text."""
    bits = (motion.contacts().numpy() > 0.5).astype(np.uint8) @ np.array([1, 2, 4, 8], np.uint8)
    return {
        "turns": _text(np.round(steady_quaternions(motion) * 32767).astype("<i2")),
        "root": _text(motion.root.numpy().astype("<f4")),
        "contact": _text(bits.astype(np.uint8)),
    }


def _numbers(motion: Motion, song) -> list[list[str]]:
    from dancediff.metrics.report import evaluate_dances

    rows = {row["name"]: row for row in evaluate_dances([motion], song=song).facts()["rows"]}
    values = [(name, rows[name]["value"]) for name in SHOWN if name in rows]
    return [[name, f"{value:.3g}"] for name, value in values if value is not None]


def _text(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
