r"""`choreograph`: an endless supply of labelled group dances in ten genres.

Read first: notebook 03, docs/choreographer.md.

Everything is planned on the beat grid (structure.py, score.py), walked by planned footsteps
(walk.py, footsteps.py) and carried by a body (body.py, arms.py). The truth comes with it: contacts,
beats, formations, order, turns, jumps. Every number measured on these dances is a number about
synthetic data.
"""

import operator
from dataclasses import dataclass

import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.data.choreographer.assemble import DancerPart, assemble, plan_parts
from dancediff.data.choreographer.formations import min_distance
from dancediff.data.choreographer.genres import draw_genre
from dancediff.data.choreographer.moves import CHANNEL
from dancediff.data.choreographer.score import Score, write_score
from dancediff.data.choreographer.structure import Section, drawn_sections, given_sections
from dancediff.motion.motion import Motion

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
    relations    (frame, name): unison, mirror, canon, call, solo
    turns        (dancer, start frame, stop frame, degrees to the left)
    jumps        (dancer, first, last frame with both feet off the floor)
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


def choreograph(
    beats,
    *,
    dancers: int = 3,
    seed: int = 0,
    seconds: float | None = None,
    genre: str | None = None,
    sections=None,
    swap: bool | None = None,
):
    """Make a group dance on a beat grid.

    ``genre`` is one of `GENRES`; by default one that suits the tempo is drawn from the seed.
    ``sections`` is the song's structure, [(start second, stop second, label), ...] as in
    `SongTruth.sections`; by default one is drawn. ``swap``: True lets two dancers change places
    in the first travel and never again, False never, None now and then.

    Shapes: beats (k,) seconds, increasing -> Motion (n dancers, round(seconds * 30) frames),
    DanceTruth. ``seconds`` defaults to the time of the last beat.
    Raises: ValueError naming the argument when the grid has fewer than 4 beats or is not
    increasing, when dancers is not 1..5, when the genre is unknown or a section is not in order.

    >>> dance, truth = choreograph(np.arange(0.2, 8, 0.5), dancers=2, seed=1, genre="salsa")
    >>> dance.num_dancers, dance.num_frames, truth.contacts.shape, truth.genre
    (2, 231, torch.Size([2, 231, 4]), 'salsa')
    """
    beats = np.asarray(beats, dtype=np.float64)
    dancers = operator.index(dancers)
    if not 1 <= dancers <= MAX_DANCERS:
        raise ValueError(f"dancers={dancers} is not in 1..{MAX_DANCERS}")
    if beats.ndim != 1 or len(beats) < 4 or not (np.diff(beats) > 0).all():
        raise ValueError("beats must be at least 4 increasing times in seconds")
    seconds = float(beats[-1]) if seconds is None else float(seconds)
    if not seconds > 0:
        raise ValueError(f"seconds={seconds} must be positive")
    beat = beat_position(beats, max(1, round(seconds * FPS)))
    rng = np.random.default_rng(seed)
    spb = float(np.median(np.diff(beats)))
    kind = draw_genre(genre, 60 / spb, rng)
    num_beats = int(np.ceil(beat[-1])) + 3
    first = round(float(np.interp(beats[0] * FPS, np.arange(len(beat)), beat)))
    for _ in range(50):
        if sections is None:
            parts = drawn_sections(num_beats, rng, 8 if swap else None)
        else:
            parts = given_sections(sections, beats, first, num_beats)
        score = write_score(dancers, kind, parts, rng, swap)
        dance = _spaced(score, kind, beat, spb, rng)
        if dance is not None:
            break
    else:
        raise ValueError(f"seed={seed} found no dance for {dancers} dancers; take another seed")
    pose, root, contacts = assemble(dance, kind, beat, spb)
    meta = {"source": "choreographer", "seed": int(seed), "genre": kind.name, "synthetic": True}
    motion = Motion(pose, root, FPS, contact=contacts, meta=meta)
    return motion, _truth(motion, kind.name, score, parts, dance, beat, beats)


def beat_position(beats: np.ndarray, num_frames: int) -> np.ndarray:
    """Where each frame lies on the beat grid, carried on evenly beyond its ends, (f,).

    The grid is shifted so that every frame lies after beat 1: steps may begin before the clip.

    >>> beat_position(np.array([0.5, 1.0, 1.5, 2.0]), 31)[[0, 15, 30]].tolist()
    [1.0, 2.0, 3.0]
    """
    time = np.arange(num_frames) / FPS
    index = np.arange(len(beats), dtype=np.float64)
    first, last = beats[1] - beats[0], beats[-1] - beats[-2]
    at = np.interp(time, beats, index)
    at = np.where(time < beats[0], (time - beats[0]) / first, at)
    at = np.where(time > beats[-1], index[-1] + (time - beats[-1]) / last, at)
    return at + max(0, int(np.ceil(1 - at[0])))


def _spaced(score: Score, kind, beat, spb: float, rng) -> list[DancerPart] | None:
    """The dancers' paths, with steps small enough that nobody meets anybody."""
    seeds = rng.integers(0, 2**31, len(score.counts))
    for reach in _REACHES:
        dance = plan_parts(score, kind, beat, spb, reach, seeds)
        if min_distance(np.stack([part.floor for part in dance])) > MIN_ROOT_DISTANCE:
            return dance
    return None


def _truth(motion, name, score: Score, sections: list[Section], dance, beat, beats) -> DanceTruth:
    f = motion.num_frames
    frames = np.round(beats * FPS).astype(int)
    x = motion.root[..., 0].numpy()

    def frame(at: float) -> int:
        return int(np.searchsorted(beat, at))

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
        relations=tuple((frame(at), kind) for at, kind in score.relations if frame(at) < f),
        turns=tuple(row for i, part in enumerate(dance) for row in _turns(i, part, frame, f)),
        jumps=tuple(row for i, part in enumerate(dance) for row in _jumps(i, part, beat, f)),
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
    for jump in part.walk.jumps:
        inside = np.flatnonzero((beat > jump.start) & (beat < jump.stop))
        if len(inside) > 2 and inside[0] > 0 and inside[-1] < f - 1:
            yield i, int(inside[0]), int(inside[-1])
