r"""One dance, however long, in a few small vectors and numbers, which `rows` joins to a table.

Read first: `dancediff.metrics.dances`, which reads a dance; each metric has a file of its own.

Only these are kept, some kilobytes for each dance, so memory hardly grows with their number.

Symbols (axes: n dancers · f frames · j joints · w windows of a dance, 1 when it is not cut)
    joints  positions, metres, y up                            (n, f, j, 3)
    beats   times of the music's beats, seconds                (k,)
    rows    feature vectors: kinetic (w n, 72), geometric (w n, 32), group (w, 72)
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from torch import Tensor

from dancediff.metrics.collision import tif
from dancediff.metrics.dances import Source, read_dance
from dancediff.metrics.drift import Drift, drift
from dancediff.metrics.formation import FORMATION
from dancediff.metrics.geometric import geometric_features
from dancediff.metrics.group import gmc, group_features
from dancediff.metrics.inputs import as_group
from dancediff.metrics.kinetic import kinetic_features
from dancediff.metrics.physical import below_floor, fsr, pfc
from dancediff.metrics.posture import POSTURE
from dancediff.metrics.rhythm import SMOOTH, beat_alignment
from dancediff.metrics.swaps import abrupt_swaps, by_rank, obeys, permutation_kind
from dancediff.metrics.unison import unison
from dancediff.motion.beats import motion_beats
from dancediff.motion.motion import Motion
from dancediff.own import own_function

LONGEST_GMC = 3000  # frames; every one is compared with every other, which takes 0.5 GiB
BELOW = "below the floor"
OBEDIENCE = "swap obedience"
LAST_OVER_FIRST = ", last / first"  # of a metric of posture: its windows of 5 s
NO_BEATS = "no beats: the dance's file holds none, and no song was given"


@dataclass
class Measured:
    """What is kept of a dance. ``missing`` says, for each metric, why windows have no number.

    ``drift`` is None for a dance shorter than 5 s.
    """

    name: str
    kind: str
    fps: float
    dancers: int
    frames: int
    rows: dict[str, list[np.ndarray]] = field(default_factory=dict)
    numbers: dict[str, list] = field(default_factory=dict)
    missing: dict[str, list[str]] = field(default_factory=dict)
    genre: str | None = None
    drift: Drift | None = None

    def add(self, into: dict, metric: str, compute: Callable, *args, **options) -> None:
        """Add what ``compute`` returns, or the reason why it cannot."""
        try:
            into.setdefault(metric, []).append(compute(*args, **options))
        except ValueError as err:
            self.missing.setdefault(metric, []).append(" ".join(str(err).split()))


def measure(
    source: Source,
    *,
    name: str = "dance",
    beats=None,
    window: int | None = None,
    metrics: tuple[str, ...] = (),
) -> Measured:
    """Read a dance and compute all that needs no other dance.

    ``beats`` (seconds from the first frame) are for dances that bring none. ``window`` cuts the
    dance into pieces of so many frames; a shorter rest is ignored. Abrupt swaps, swap obedience,
    formations and drift are of the whole dance in any case: a jump between two windows is one too.
    ``metrics`` are functions of the user's own, "module:function", called as `joint_speed` is.

    Raises: ValueError or OSError when the dance cannot be read.

    >>> import torch
    >>> still = Motion(torch.eye(3).expand(2, 30, 24, 3, 3), torch.zeros(2, 30, 3))
    >>> found = measure(still, beats=[0.5])
    >>> found.numbers["TIF"], found.numbers["BAS"], found.rows["kinetic"][0].shape
    ([1.0], [0.0], (2, 72))
    """
    dance = read_dance(source, name)
    motion, beats = dance.motion, dance.beats if dance.beats is not None else beats
    f, fps = motion.num_frames, float(motion.fps)
    found = Measured(dance.name, dance.kind, fps, motion.num_dancers, f, genre=dance.genre)
    joints = motion.joints()
    size = f if window is None else window
    if f < size:
        why = f"a dance has {f} frames, fewer than the window of {size}"
        found.missing = {metric: [why] for metric in (*FEATURES, *NUMBERS, *RHYTHM, *metrics)}
    for start in range(0, f - size + 1, size):
        shifted = None if beats is None else np.asarray(beats, dtype=np.float64) - start / fps
        _measure_window(found, joints[:, start : start + size], fps, shifted)
        for metric in metrics:
            piece = joints[:, start : start + size]
            found.add(found.numbers, metric, own_metric, metric, piece, fps=fps)
    _measure_swaps(found, motion)
    for metric, (number, _) in FORMATION.items():
        found.add(found.numbers, metric, number, joints, fps=fps)
    _measure_drift(found, joints)
    return found


def _measure_window(found: Measured, joints: Tensor, fps: float, beats) -> None:
    for metric, features in FEATURES.items():
        found.add(found.rows, metric, _feature_rows, features, joints, fps)
    for metric, number in NUMBERS.items():
        found.add(found.numbers, metric, number, joints, fps=fps)
    for metric, direction in RHYTHM.items():
        found.add(found.numbers, metric, _alignment, joints, beats, fps=fps, direction=direction)


def _measure_swaps(found: Measured, motion: Motion) -> None:
    root, swap = motion.root, motion.meta.get("swap")
    seams = motion.meta.get("seams")  # a dance that was never joined has none
    found.add(
        found.numbers,
        "abrupt swaps",
        lambda: float(len(abrupt_swaps(root, fps=motion.fps, seams=seams))),
    )
    if not isinstance(swap, list | tuple):
        found.missing[OBEDIENCE] = ["meta of the dance has no target order (swap)"]
        return
    found.add(found.numbers, OBEDIENCE, lambda: float(obeys(root, by_rank(root, swap))))
    if len(root) == 3 and found.numbers.get(OBEDIENCE):
        kind = permutation_kind(by_rank(root, swap))
        found.numbers[f"{OBEDIENCE}, {kind}"] = found.numbers[OBEDIENCE]


def _measure_drift(found: Measured, joints: Tensor) -> None:
    """Posture window by window; of two or more, the first and the last."""
    try:
        found.drift = drift(joints, fps=found.fps)
    except ValueError:  # shorter than a window, or not finite, which other rows say
        return
    if len(found.drift.seconds) > 1:
        for name in found.drift.names:
            found.numbers[f"{name}{LAST_OVER_FIRST}"] = [found.drift.ends(name)]


def _feature_rows(features: Callable, joints: Tensor, fps: float) -> np.ndarray:
    rows = np.atleast_2d(features(joints, fps=fps).numpy())
    if not np.isfinite(rows).all():
        raise ValueError("joints gave features that are not finite; repair the motion first")
    return rows


def _short_gmc(joints: Tensor, *, fps: float) -> float:
    if (f := joints.shape[1]) > LONGEST_GMC:
        raise ValueError(f"{f} frames are too long for GMC, {LONGEST_GMC} at most; pass a window")
    return gmc(joints, fps=fps)


def _alignment(joints: Tensor, beats, **options) -> float:
    if beats is None:
        raise ValueError(NO_BEATS)
    return beat_alignment(joints, beats, **options)


def own_metric(name: str, joints: Tensor, *, fps: float) -> float:
    """The number of a function of the user's own, "module:function".

    Raises: ValueError when it fails, or returns anything but one finite number.
    """
    try:
        value = float(own_function(name, "metric")(joints, fps=fps))
    except Exception as err:  # one odd dance must not end the table
        raise ValueError(f"metric={name!r} fails: {type(err).__name__}: {err}") from err
    if not np.isfinite(value):
        raise ValueError(f"metric={name!r} returned {value}; it must be a finite number")
    return value


def joint_speed(joints: Tensor, *, fps: float) -> float:
    """Mean speed of all joints, metres a second; (n, f, j, 3) -> float.

    Raises: ValueError for fewer than 2 frames or NaN.

    >>> import torch
    >>> along_x = torch.arange(4.0)[None, :, None, None] * torch.tensor([0.5, 0, 0])
    >>> joint_speed(along_x.expand(1, 4, 24, 3), fps=30.0)
    15.0
    """
    joints = as_group(joints, fps, least=2)
    return joints.diff(dim=1).norm(dim=-1).mean().item() * fps


def beats_per_second(joints: Tensor, *, fps: float) -> float:
    """Motion beats of a dancer in a second, mean over dancers; (n, f, j, 3) -> float.

    Raises: ValueError for fewer than 3 frames or NaN.
    """
    joints = as_group(joints, fps, least=3)
    counts = [len(motion_beats(dancer, sigma=SMOOTH * fps)) for dancer in joints]
    return float(np.mean(counts)) * fps / joints.shape[1]


FEATURES: dict[str, Callable] = {
    "kinetic": kinetic_features,
    "geometric": geometric_features,
    "group": group_features,
}
NUMBERS: dict[str, Callable] = {
    "GMC": _short_gmc,
    "unison": unison,
    "TIF": lambda joints, fps: tif(joints),
    "PFC": pfc,
    "FSR": fsr,
    BELOW: below_floor,
    "joint speed": joint_speed,
    "motion beats": beats_per_second,
    **{name: metric for name, (metric, _) in POSTURE.items()},
}
RHYTHM = {"MMC": "motion", "BAS": "music"}  # and the direction in which beats are compared
