r"""`choreograph`: an endless supply of labelled group dances in ten genres.

Read first: notebook 03, docs/choreographer.md.

Everything is planned on the beat grid (structure.py, score.py), walked by planned footsteps
(walk.py, footsteps.py) and carried by a body (body.py, arms.py). The truth comes with it: contacts,
beats, formations, order, turns, jumps. Every number measured on these dances is a number about
synthetic data.
"""

import operator
from dataclasses import dataclass
from os import PathLike
from typing import TypedDict, Unpack

import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.data.choreographer.assemble import DancerPart, assemble, plan_parts
from dancediff.data.choreographer.formations import min_distance
from dancediff.data.choreographer.genres import draw_genre
from dancediff.data.choreographer.grid import Grid, make_grid
from dancediff.data.choreographer.loudness import corrected, cut_at_drops, heard
from dancediff.data.choreographer.moves import CHANNEL, in_three
from dancediff.data.choreographer.score import Score, write_score
from dancediff.data.choreographer.structure import (
    IN_THREE,
    Section,
    cut_by_gaps,
    drawn_sections,
    given_sections,
)
from dancediff.data.choreographer.ways import quick_look, ways_of
from dancediff.motion.motion import Motion
from dancediff.music.song import Music

MAX_DANCERS = 5
MIN_ROOT_DISTANCE = 0.55  # metres; a dance that comes closer takes smaller steps, or is drawn again
_REACHES = (1.0, 0.7, 0.4, 0.2)


@dataclass(frozen=True)
class DanceTruth:
    """What the choreographer knows about its dance.

    beats        frames on which a beat falls                        (k,)
    contacts     foot planted, by plan                               (n, f, 4)
    formations   (frame, name, slots (n, 2) metres by dancer)
    order_start  dancers from left to right in the first frame       (n,)
    order_end    the same in the last frame                          (n,)
    genre        name of the genre
    sections     (start frame, stop frame, label, danced mirrored)
    relations    (frame, name) of `relations.py`, or breath where there is no beat
    turns        (dancer, start frame, stop frame, degrees to the left)
    jumps        (dancer, first, last frame with both feet off the floor)
    breaths      (start frame, stop frame) where the music has no beat
    """

    beats: np.ndarray
    contacts: torch.Tensor
    formations: list[tuple[int, str, np.ndarray]]
    order_start: np.ndarray
    order_end: np.ndarray
    genre: str = ""
    sections: tuple = ()
    relations: tuple = ()
    turns: tuple = ()
    jumps: tuple = ()
    breaths: tuple = ()


class Hearing(TypedDict, total=False):
    """What else `choreograph` may be told about the music: meter, and energy (f,)."""

    meter: int | None
    energy: object


def choreograph(
    beats,
    *,
    dancers: int = 3,
    seed: int = 0,
    seconds: float | None = None,
    genre: str | None = None,
    sections=None,
    swap: bool | None = None,
    **music: Unpack[Hearing],
):
    """Make a group dance on a beat grid.

    Where beats lie more than 2.2 s apart, before the first and after the last one, the music has no
    beat: people breathe, slowly, or walk to another formation, and start again on the beat that
    comes back. A song may have no beat at all.

    ``genre`` is one of `GENRES`, no matter its capitals, spaces and hyphens; by default one that
    suits the tempo is drawn from the seed.
    ``sections`` is the song's structure, [(start second, stop second, label), ...] as in
    `SongTruth.sections`; by default one is drawn. ``swap``: True lets two dancers change places
    in the first travel and never again, False never, None now and then. ``meter`` is how many beats
    a bar has; the first beat begins a bar. In bars of 3 or 6, phrases last 6 beats rather than 8.
    ``energy`` is how loud the music is in each frame, as `energy_curve` tells: the louder, the
    larger and livelier; where it rises all at once people accent it, where it breaks off they hold.

    Shapes: beats (k,) seconds, increasing -> Motion (n dancers, round(seconds * 30) frames),
    DanceTruth. ``seconds`` defaults to the time of the last beat.
    Raises: ValueError naming the argument when beats are a song or not increasing, when dancers is
    not 1..5, seconds hold no two frames, the seed is negative, swap is none of True, False and
    None, the genre is unknown, a section is not in order or the meter is not 1 or more.

    >>> dance, truth = choreograph(np.arange(0.2, 8, 0.5), dancers=2, seed=1, genre="salsa")
    >>> dance.num_dancers, dance.num_frames, truth.contacts.shape, truth.genre
    (2, 231, torch.Size([2, 231, 4]), 'salsa')
    """
    dancers, seed = _checked(dancers, seed, swap)
    if isinstance(beats, str | PathLike | Music):
        raise ValueError(f"beats={beats!r} is no list of times in seconds; give song.beats()")
    beats, meter = np.asarray(beats, dtype=np.float64), music.pop("meter", None)
    energy = music.pop("energy", None)
    if music:
        raise TypeError(f"choreograph has no argument {next(iter(music))!r}")
    grid = _grid(beats, seconds, meter)
    rng = np.random.default_rng(seed)
    kind = draw_genre(genre, 60 / grid.spb, rng)
    kind = in_three(kind) if grid.phrase == IN_THREE else kind
    loud = None
    if energy is not None:
        loud, grid = heard(_curve(energy, len(grid.beat)), grid, kind, ways_of(kind))
    for _ in range(50):
        parts = _structure(grid, sections, rng, swap, meter)
        parts = parts if loud is None else cut_at_drops(parts, loud.drops)
        score = write_score(dancers, kind, parts, rng, swap, loud)
        if loud is not None:
            seen = quick_look(score, kind, grid)
            score.counts = corrected(score.counts, score.centre, seen, loud)
        dance = _spaced(score, kind, grid, rng)
        if dance is not None:
            break
    else:
        raise ValueError(f"seed={seed} found no dance for {dancers} dancers; take another seed")
    pose, root, contacts = assemble(dance, kind, grid)
    meta = {"source": "choreographer", "seed": int(seed), "genre": kind.name, "synthetic": True}
    motion = Motion(pose, root, FPS, contact=contacts, meta=meta)
    return motion, _truth(motion, kind.name, score, parts, dance, grid, beats)


def _checked(dancers, seed, swap) -> tuple[int, int]:
    """Dancers and seed as int.

    Raises: ValueError naming the argument.
    """
    dancers, seed = _whole("dancers", dancers), _whole("seed", seed)
    if not 1 <= dancers <= MAX_DANCERS:
        raise ValueError(f"dancers={dancers} is not in 1..{MAX_DANCERS}")
    if seed < 0:
        raise ValueError(f"seed={seed} must be an integer of at least 0")
    if not (swap is None or isinstance(swap, bool | np.bool_)):  # an order would count as True
        raise ValueError(
            f"swap={swap!r} must be True (two change places), False (never) or None (now and then);"
            " which order they end in is drawn from the seed"
        )
    return dancers, seed


def _whole(name: str, value) -> int:
    """Raises: ValueError naming the argument for what is no integer."""
    try:
        return operator.index(value)
    except TypeError:
        raise ValueError(f"{name}={value!r} must be an integer") from None


def _grid(beats: np.ndarray, seconds: float | None, meter: int | None) -> Grid:
    """Counts of a dance, after a look at the arguments."""
    if beats.ndim != 1 or not np.isfinite(beats).all() or not (np.diff(beats) > 0).all():
        raise ValueError("beats must be increasing times in seconds")
    if seconds is None and len(beats) == 0:
        raise ValueError("seconds=None ends with the last beat, but beats are empty; give seconds")
    seconds = float(beats[-1]) if seconds is None else float(seconds)
    if not seconds * FPS >= 1.5:
        raise ValueError(f"seconds={seconds} must hold two frames, {2 / FPS:.2f} s, or more")
    if meter is not None and _whole("meter", meter) < 1:
        raise ValueError(f"meter={meter} must be 1 or more beats a bar, or None")
    return make_grid(beats, round(seconds * FPS), meter)


def _curve(energy, num_frames: int) -> np.ndarray:
    """Energy of every frame, checked; a curve that is a little short goes on as it ends."""
    curve = np.asarray(energy, dtype=np.float64)
    if curve.ndim != 1 or not ((curve >= 0) & (curve <= 1)).all():
        raise ValueError("energy must be a curve (f,) of numbers in 0..1, or None")
    if len(curve) < num_frames - FPS:
        raise ValueError(
            f"energy has {len(curve)} frames, the dance has {num_frames}; give one for each"
        )
    return np.pad(curve, (0, max(0, num_frames - len(curve))), mode="edge")[:num_frames]


def _structure(grid: Grid, sections, rng, swap: bool | None, meter: int | None) -> list[Section]:
    """Sections on the counts; those without a beat are marked."""
    if sections is not None:
        parts = given_sections(sections, grid.anchors, grid.first, grid.length)
    else:
        lead = grid.phrase if swap else None
        if meter is not None:  # phrases begin where bars do
            lead = (lead or 0) + (-grid.first) % grid.phrase
        parts = drawn_sections(grid.length, rng, lead, grid.phrase)
    return cut_by_gaps(parts, grid.gaps)


def _spaced(score: Score, kind, grid: Grid, rng) -> list[DancerPart] | None:
    """The dancers' paths, with steps small enough that nobody meets anybody."""
    seeds = rng.integers(0, 2**31, len(score.counts))
    for reach in _REACHES:
        dance = plan_parts(score, kind, grid, reach, seeds)
        if min_distance(np.stack([part.floor for part in dance])) > MIN_ROOT_DISTANCE:
            return dance
    return None


def _truth(motion, name, score: Score, sections: list[Section], dance, grid: Grid, beats):
    f = motion.num_frames
    frames = np.round(beats * FPS).astype(int)
    x = motion.root[..., 0].numpy()

    frame = grid.frame
    formations = [
        (0 if at == 0 else frame(at), name, place) for at, name, place in score.formations
    ]
    return DanceTruth(
        beats=frames[(frames >= 0) & (frames < f)],
        contacts=motion.contact,
        formations=[row for row in formations if row[0] < f],
        order_start=np.argsort(x[:, 0]),
        order_end=np.argsort(x[:, -1]),
        genre=name,
        sections=tuple(
            (frame(s.start), frame(s.stop), s.label, s.mirrored)
            for s in sections
            if frame(s.start) < f and frame(s.stop) > 0
        ),
        relations=tuple({frame(at): kind for at, kind in score.relations if frame(at) < f}.items()),
        turns=tuple(row for i, part in enumerate(dance) for row in _turns(i, part, frame, f)),
        breaths=tuple(
            (max(frame(start - 1), 0), min(frame(stop), f))
            for start, stop in grid.gaps
            if frame(start - 1) < f and frame(stop) > 0
        ),
        jumps=tuple(row for i, part in enumerate(dance) for row in _jumps(i, part, grid.beat, f)),
    )


def _turns(i: int, part: DancerPart, frame, f: int):
    """Where the planned facing goes round by a full turn within one move."""
    face = part.walk.on[:, CHANNEL["face"]]
    base = np.round(face / 360)
    for k in np.flatnonzero(np.diff(base)):
        start = k
        while start > 0 and abs(face[start] - 360 * base[k]) > 20:
            start -= 1
        stop = k + 1
        while stop < len(face) - 1 and abs(face[stop] - 360 * base[k + 1]) > 20:
            stop += 1
        if frame(start) > 0 and frame(stop) < f:
            yield i, frame(start), frame(stop), float(360 * (base[k + 1] - base[k]))


def _jumps(i: int, part: DancerPart, beat: np.ndarray, f: int):
    stands = np.any([foot.planted for foot in part.feet], (0, 2))  # also just before it has landed
    for jump in part.walk.jumps:
        inside = np.flatnonzero((beat > jump.start) & (beat < jump.stop) & ~stands)
        if len(inside) > 2 and inside[0] > 0 and inside[-1] < f - 1:
            yield i, int(inside[0]), int(inside[-1])
