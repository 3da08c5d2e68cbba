r"""One dance, however long, in a few small vectors and numbers, which `rows` joins to a table.

Symbols (axes: n dancers · f frames · j joints · w windows of a dance, 1 when it is not cut)
    joints  positions, metres, y up                            (n, f, j, 3)
    beats   times of the music's beats, seconds                (k,)
    rows    feature vectors: kinetic (w n, 72), geometric (w n, 32), group (w, 72)
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from torch import Tensor

from dancediff.arrays import read_arrays
from dancediff.data.take import KINDS, DanceTake
from dancediff.metrics.collision import tif
from dancediff.metrics.geometric import geometric_features
from dancediff.metrics.group import gmc, group_features
from dancediff.metrics.inputs import as_group
from dancediff.metrics.kinetic import kinetic_features
from dancediff.metrics.physical import fsr, pfc
from dancediff.metrics.posture import POSTURE
from dancediff.metrics.rhythm import SMOOTH, beat_alignment
from dancediff.metrics.swaps import abrupt_swaps, obeys, permutation_kind
from dancediff.motion.beats import motion_beats
from dancediff.motion.motion import Motion

LONGEST_GMC = 3000  # frames; every one is compared with every other, which takes 0.5 GiB
SHORTEST_WINDOW = 3  # frames; what an acceleration needs
OBEDIENCE = "swap obedience"
NO_BEATS = "no beats: the dance's file holds none, and no song was given"
Source = Path | Motion | DanceTake


@dataclass
class Measured:
    """What is left of a dance. ``missing`` holds, for each metric, why windows have no number."""

    name: str
    kind: str  # real, composed, synthetic, generated, unknown
    fps: float
    dancers: int
    frames: int
    rows: dict[str, list[np.ndarray]] = field(default_factory=dict)
    numbers: dict[str, list[float]] = field(default_factory=dict)
    missing: dict[str, list[str]] = field(default_factory=dict)

    def keep(self, into: dict, metric: str, compute: Callable) -> None:
        """Add what ``compute()`` returns, or the reason why it cannot."""
        try:
            into.setdefault(metric, []).append(compute())
        except ValueError as err:
            self.missing.setdefault(metric, []).append(" ".join(str(err).split()))


def read_dance(source: Source, name: str = "dance") -> tuple[str, str, Motion, np.ndarray | None]:
    """Name, kind, motion and beats of a dance; beats are None where the source has none.

    Kinds are those of takes; what a model made is "generated", what does not say is "unknown".

    Raises: ValueError or OSError when a file cannot be read.
    """
    if isinstance(source, DanceTake):
        return source.name, source.kind, source.motion, source.beats
    if isinstance(source, Motion):
        return str(source.meta.get("name", name)), _kind(source.meta), source, None
    motion, more = Motion.load(source), read_arrays(source, ("take", "beats"))
    kind = _kind(motion.meta)
    if "take" in more:
        row = json.loads(str(more["take"]))
        kind = _kind(row) if isinstance(row, dict) else kind
    beats = more.get("beats")
    if beats is not None and beats.dtype.kind not in "fiu":
        raise ValueError(f"{str(source)!r}: beats holds {beats.dtype}, not times in seconds")
    return source.stem, kind, motion, beats


def _kind(meta: dict) -> str:
    if meta.get("kind") in KINDS:
        return meta["kind"]
    if meta.get("synthetic"):
        return "synthetic"
    return "generated" if "model" in meta else "unknown"


def measure(
    source: Source, *, name: str = "dance", beats=None, window: int | None = None
) -> Measured:
    """Read a dance and compute all that needs no other dance.

    ``beats`` (seconds from the first frame) are for dances that bring none. ``window`` cuts the
    dance into pieces of so many frames; what is left at its end is not looked at. Abrupt swaps and
    swap obedience are of the whole dance in any case: a jump between two windows is one too.

    Raises: ValueError or OSError when the dance cannot be read.

    >>> import torch
    >>> still = Motion(torch.eye(3).expand(2, 30, 24, 3, 3), torch.zeros(2, 30, 3))
    >>> found = measure(still, beats=[0.5])
    >>> found.numbers["TIF"], found.numbers["BAS"], found.rows["kinetic"][0].shape
    ([1.0], [0.0], (2, 72))
    """
    name, kind, motion, own = read_dance(source, name)
    beats = own if own is not None else beats
    n, f, fps = motion.num_dancers, motion.num_frames, motion.fps
    found = Measured(name, kind, float(fps), n, f)
    joints = motion.joints()
    size = f if window is None else window
    if f < size:
        why = f"a dance has {f} frames, fewer than the window of {size}"
        found.missing = {metric: [why] for metric in (*FEATURES, *NUMBERS)}
    for start in range(0, f - size + 1, size):
        shifted = None if beats is None else np.asarray(beats, dtype=np.float64) - start / fps
        _measure_window(found, joints[:, start : start + size], fps, shifted)
    _measure_swaps(found, motion)
    return found


def _measure_window(found: Measured, joints: Tensor, fps: float, beats) -> None:
    for metric, features in FEATURES.items():
        found.keep(found.rows, metric, partial(_rows, features, joints, fps))
    for metric, number in NUMBERS.items():
        found.keep(found.numbers, metric, partial(number, joints, fps, beats))


def _measure_swaps(found: Measured, motion: Motion) -> None:
    root, swap = motion.root, motion.meta.get("swap")
    seams = motion.meta.get("seams")  # a dance that was never joined has none

    def count() -> float:
        return float(len(abrupt_swaps(root, fps=motion.fps, seams=seams)))

    found.keep(found.numbers, "abrupt swaps", count)
    if not isinstance(swap, list | tuple):
        found.missing[OBEDIENCE] = ["the dance does not say which order was asked for"]
        return
    found.keep(found.numbers, OBEDIENCE, lambda: float(obeys(root, swap)))
    if len(root) == 3 and OBEDIENCE in found.numbers and found.numbers[OBEDIENCE]:
        found.numbers[f"{OBEDIENCE}, {permutation_kind(swap)}"] = found.numbers[OBEDIENCE]


def _rows(features: Callable, joints: Tensor, fps: float) -> np.ndarray:
    rows = np.atleast_2d(features(joints, fps=fps).numpy())
    if not np.isfinite(rows).all():
        raise ValueError("joints gave features that are not finite; repair the motion first")
    return rows


def _gmc(joints: Tensor, fps: float) -> float:
    if joints.shape[1] > LONGEST_GMC:
        f = joints.shape[1]
        raise ValueError(f"{f} frames are too long for GMC, {LONGEST_GMC} at most; pass a window")
    return gmc(joints, fps=fps)


def _alignment(direction: str, joints: Tensor, fps: float, beats) -> float:
    if beats is None:
        raise ValueError(NO_BEATS)
    return beat_alignment(joints, beats, fps=fps, direction=direction)


def joint_speed(joints: Tensor, fps: float) -> float:
    """Mean speed of all joints, metres a second; (n, f, j, 3) -> float.

    Raises: ValueError for fewer than 2 frames or NaN.

    >>> import torch
    >>> along_x = torch.arange(4.0)[None, :, None, None] * torch.tensor([0.5, 0, 0])
    >>> joint_speed(along_x.expand(1, 4, 24, 3), 30.0)
    15.0
    """
    joints = as_group(joints, fps, least=2)
    return joints.diff(dim=1).norm(dim=-1).mean().item() * fps


def beats_per_second(joints: Tensor, fps: float) -> float:
    """Motion beats of a dancer in a second, mean over dancers; (n, f, j, 3) -> float.

    Raises: ValueError for fewer than 3 frames or NaN.
    """
    joints = as_group(joints, fps, least=3)
    counts = [len(motion_beats(dancer, sigma=SMOOTH * fps)) for dancer in joints]
    return float(np.mean(counts)) * fps / joints.shape[1]


def _posture(metric: Callable, joints: Tensor, fps: float, beats) -> float:
    return metric(joints, fps=fps)


FEATURES: dict[str, Callable] = {
    "kinetic": kinetic_features,
    "geometric": geometric_features,
    "group": group_features,
}
NUMBERS: dict[str, Callable] = {  # (joints, fps, beats) -> float
    "GMC": lambda joints, fps, beats: _gmc(joints, fps),
    "TIF": lambda joints, fps, beats: tif(joints),
    "MMC": lambda joints, fps, beats: _alignment("motion", joints, fps, beats),
    "BAS": lambda joints, fps, beats: _alignment("music", joints, fps, beats),
    "PFC": lambda joints, fps, beats: pfc(joints, fps=fps),
    "FSR": lambda joints, fps, beats: fsr(joints, fps=fps),
    "joint speed": lambda joints, fps, beats: joint_speed(joints, fps),
    "motion beats": lambda joints, fps, beats: beats_per_second(joints, fps),
    **{name: partial(_posture, metric) for name, (metric, _) in POSTURE.items()},
}
