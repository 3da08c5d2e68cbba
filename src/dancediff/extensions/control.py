r"""Control: what a caller may fix about a dance, as entries of its motion vectors.

Read first: notebook 10 · `dancediff.extensions.constraint`.

    model.generate(song, dancers=3, start=[(-1, 0), (0, 1), (1, 0)], constraints=[
        WalkAlong(1, [(0, 0, 1), (2.5, 0.5, 0), (5, 0, -1)]),     # seconds, x, z
        Keep(other, seconds=(0, 2)),                              # go on from another dance
        Keep(other, joints="upper body"),                         # with its arms
    ])

Symbols (axes: n dancers · F frames of the dance · d motion features, in metres and matrices)
    mask, value, slack   see `Constraint`   (n, F, d)

Dancers are numbered by the caller. Where the constraints say where everybody starts, any numbers
will do; else number k must be the k-th from the left at the start.
"""

import math
import operator
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from numbers import Real

import torch
from torch import Tensor

from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.constraint import Constraint
from dancediff.motion.motion import Motion
from dancediff.motion.order import left_to_right
from dancediff.motion.representation import TCDIFFPP, Normalizer

X, Z = range(TCDIFFPP.dim)[TCDIFFPP.floor]
UPPER = "belly spine chest neck head {}collar {}shoulder {}elbow {}wrist {}hand"
LOWER = "root {}hip {}knee {}ankle {}toe"
CLOSE = 0.3  # metres between two dancers, below which bodies overlap
STAGE = 3.0  # metres from its middle; only the outermost of five dancers go farther in training
SAME = 1e-3  # two constraints may say the same twice
HOLD = 60  # frames that move as one with a given place: from 3 m out 30 left steps of 24 cm, 60 of
# 14, and of 3 where places are cut wider, too (two or three seeds)
HELD_SLACK = 0.01  # of them, normalised: a centimetre with the packaged weights


@dataclass(frozen=True)
class StartAt:
    """A formation in the first frame: one (x, z) in metres for each dancer."""

    places: Sequence[tuple[float, float]]

    def constraint(self, n: int, frames: int, fps: float) -> Constraint:
        """Of a dance of n dancers."""
        return _formation(self.places, n, frames, 0, "start")


@dataclass(frozen=True)
class EndAt:
    """A formation in the last frame: one (x, z) in metres for each dancer."""

    places: Sequence[tuple[float, float]]

    def constraint(self, n: int, frames: int, fps: float) -> Constraint:
        """Of a dance of n dancers."""
        return _formation(self.places, n, frames, frames - 1, "end")


@dataclass(frozen=True)
class WalkAlong:
    """A path on the stage floor: points (second, x, z), at rising times, joined smoothly.

    Between the first and the last of them the dancer's root is on the path, give or take a few
    times ``slack`` metres: steps make a root sway.
    """

    dancer: int
    points: Sequence[tuple[float, float, float]]
    slack: float = 0.008

    def constraint(self, n: int, frames: int, fps: float) -> Constraint:
        """Of a dance of n dancers."""
        from scipy.interpolate import PchipInterpolator

        k = _dancer(self.dancer, n)
        points = _numbers(self.points, 3, "points")
        _check_stage(points[:, 1:], "points")
        times = points[:, 0] * fps
        if (times.diff() <= 0).any() or times[0] < 0 or times[-1] > frames:
            raise ValueError(
                f"points has the times {[round(sec, 2) for sec in (times / fps).tolist()]}; they "
                f"must rise from 0 or later to at most {frames / fps:g} s"
            )
        if not self.slack >= 0:
            raise ValueError(f"slack={self.slack} is no length; choose metres, 0 or more")
        path = points[:, 1:].numpy()
        if len(points) == 1:
            at = times.round().clamp(max=frames - 1).long()
        else:
            at = torch.arange(math.ceil(times[0]), min(math.floor(times[-1]), frames - 1) + 1)
            path = PchipInterpolator(times.numpy(), path)(at.numpy())
        if not len(at):
            raise ValueError(
                f"points has the times {[round(sec, 3) for sec in (times / fps).tolist()]}; no "
                f"frame lies between them: they need to be {1 / fps:.3f} s apart"
            )
        mask, value = _nothing(n, frames)
        for column, feature in enumerate((X, Z)):
            mask[k, at, feature] = True
            value[k, at, feature] = torch.as_tensor(path[:, column], dtype=value.dtype)
        return Constraint(mask, value, mask * float(self.slack))


@dataclass(frozen=True)
class Keep:
    """A part of another dance, unchanged: what is not named is kept whole.

    ``seconds``: (from, to), or several such pairs. ``joints``: names, or "upper body" or "lower
    body"; with the joint "root" its place is kept, too, and with all joints the foot contacts.
    ``dancers``: their numbers, the same in both dances.
    """

    dance: Motion
    seconds: Sequence | None = None
    joints: Sequence[str] | str | None = None
    dancers: Sequence[int] | None = None

    def constraint(self, n: int, frames: int, fps: float) -> Constraint:
        """Of a dance of n dancers."""
        if not isinstance(self.dance, Motion):
            raise ValueError(f"dance={self.dance!r} is no Motion; give Motion.load(path)")
        if self.dance.fps != fps:
            raise ValueError(f"dance has {self.dance.fps:g} frames a second, not {fps:g}")
        who = range(self.dance.num_dancers) if self.dancers is None else self.dancers
        who = [_dancer(k, min(n, self.dance.num_dancers)) for k in who]
        f = min(frames, self.dance.num_frames)
        when = torch.zeros(frames, dtype=torch.bool)
        for start, stop in self._pairs():
            when[round(start * fps) : min(round(stop * fps), f)] = True
        what = torch.zeros(TCDIFFPP.dim, dtype=torch.bool)
        what[self._features()] = True
        mask, value = _nothing(n, frames)
        value[who, :f] = self.dance.features()[who, :f]
        mask[who] = when[:, None] & what
        if not mask.any():
            raise ValueError(f"seconds={self.seconds} keeps nothing of a dance of {f / fps:g} s")
        return Constraint(mask, value)

    def _pairs(self) -> list:
        if self.seconds is None:
            return [(0, self.dance.num_frames / self.dance.fps)]
        try:
            pairs = [self.seconds] if isinstance(self.seconds[0], Real) else self.seconds
            pairs = _numbers(pairs, 2, "seconds").tolist()
            if not all(0 <= start < stop for start, stop in pairs):
                raise ValueError
            return pairs
        except (TypeError, IndexError, ValueError):
            raise ValueError(
                f"seconds={self.seconds!r} must be (from, to) with 0 <= from < to, or several such "
                "pairs"
            ) from None

    def _features(self) -> list[int]:
        if self.joints is None:
            return list(range(TCDIFFPP.dim))
        names = self.dance.skeleton.names
        wanted = self.joints
        if isinstance(wanted, str):
            if wanted not in ("upper body", "lower body"):
                raise ValueError(f"joints={wanted!r}: give 'upper body', 'lower body' or names")
            wanted = (UPPER if wanted == "upper body" else LOWER).split()
            wanted = [w.format(side) for w in wanted for side in ("lr" if "{" in w else " ")]
        unknown = [w for w in wanted if w not in names]
        if unknown:
            raise ValueError(f"joints has {unknown[0]!r}, which is none of {', '.join(names)}")
        first = TCDIFFPP.rot6d.start
        found = [first + 6 * names.index(w) + c for w in dict.fromkeys(wanted) for c in range(6)]
        return found + list(range(X, X + 3)) * ("root" in wanted)


Control = StartAt | EndAt | WalkAlong | Keep


def combine(controls: Iterable[Control], n: int, frames: int, fps: float) -> Constraint | None:
    """All constraints as one, in metres and matrices; None when there is none.

    Raises: ValueError when two ask for different things, or one does not fit the dance.

    >>> both = combine([StartAt([(-1, 0), (1, 0)]), EndAt([(1, 0), (-1, 0)])], 2, 150, 30)
    >>> both.mask.sum(dim=(0, 2)).nonzero().flatten().tolist()
    [0, 149]
    """
    all_of_it = None
    for control in controls:
        if not isinstance(control, StartAt | EndAt | WalkAlong | Keep):
            raise ValueError(f"constraints has {control!r}; give StartAt, EndAt, WalkAlong or Keep")
        one = control.constraint(n, frames, fps)
        if all_of_it is not None:
            twice = one.mask & all_of_it.mask
            apart = (one.value - all_of_it.value).abs()
            allowed = SAME + 3 * torch.maximum(one.slack, all_of_it.slack)
            if (apart > allowed)[twice].any():
                raise ValueError(
                    f"constraints: {type(control).__name__} and an earlier one ask for different "
                    f"things in the same frames ({apart[twice].max():.2f} apart); leave one out"
                )
            one = all_of_it.over(one)
        all_of_it = one
    return all_of_it


def normalized(constraint: Constraint, normalizer: Normalizer) -> Constraint:
    """From metres and matrices to the network's units."""
    value = normalizer.normalize(constraint.value.to(normalizer.low))
    slack = constraint.slack.to(value) / normalizer.scale
    return Constraint(constraint.mask.to(value.device), value, slack)


@dataclass(frozen=True)
class NearbyFrames:
    """A `Source`: frames around a single frame with a given place move as that frame does.

    Else a dancer who shall start far outside leaves that place within a few frames: the guess
    has all the other frames where the network would rather have them, and feet stand there.

    ``constraint``: in normalised features; ``reach``: how many frames to either side, but at most a
    third of the way to the next frame with a given place.

    >>> mask, value = _nothing(1, 150)
    >>> mask[0, 0, X], value[0, 0, X] = True, 2.0
    >>> near = NearbyFrames(Constraint(mask, value)).at(torch.zeros(1, 150, TCDIFFPP.dim), 0.5)
    >>> near.mask[0, :, X].sum().item() - 1 == HOLD, near.value[0, [0, HOLD], X].tolist()
    (True, [2.0, 2.0])
    """

    constraint: Constraint
    reach: int = HOLD

    def for_segment(self, segment: Segment) -> "NearbyFrames":
        """The same for a segment."""
        return replace(self, constraint=self.constraint.for_segment(segment))

    def at(self, guess: Tensor, abar: float) -> Constraint | None:
        """The guess (n, f, d), moved near those frames; None where there is none."""
        mask, value = torch.zeros_like(guess, dtype=torch.bool), guess.clone()
        for n in range(len(guess)):
            for feature in (X, Z):
                frames = self.constraint.mask[n, :, feature].nonzero()[:, 0].tolist()
                for k, f in enumerate(frames):
                    next_to_it = frames[max(0, k - 1) : k] + frames[k + 1 : k + 2]
                    reach = min([self.reach, *(abs(f - g) // 3 for g in next_to_it)])
                    if reach > 0:  # else a neighbour is given, too: a path, or a part of a dance
                        near = slice(max(0, f - reach), f + reach + 1)
                        mask[n, near, feature] = True
                        step = self.constraint.value[n, f, feature].to(guess) - guess[n, f, feature]
                        value[n, near, feature] += step
        if not mask.any():
            return None
        return Constraint(mask, value, torch.full_like(value, HELD_SLACK))


def initial_order(constraint: Constraint) -> Tensor | None:
    """Dancers from left to right at the first frame, if that is known of all of them.

    Raises: ValueError when it is known of some whose numbers do not rise from the left.
    """
    known, x = constraint.mask[:, 0, X], constraint.value[:, 0, X]
    if known.all():
        return left_to_right(x)
    if (x[known].diff() < 0).any():
        raise ValueError(
            "constraints say where some dancers start, and their numbers do not rise from left to "
            "right; number them so, or give start= for all of them"
        )
    return None


def final_order(constraint: Constraint) -> Tensor | None:
    """Dancers from left to right in the last frame, if that is known of all of them."""
    known, x = constraint.mask[:, -1, X], constraint.value[:, -1, X]
    return left_to_right(x) if known.all() else None


def _formation(places, n: int, frames: int, frame: int, name: str) -> Constraint:
    places = _numbers(places, 2, name)
    if len(places) != n:
        raise ValueError(f"{name} has {len(places)} places for {n} dancers; give one (x, z) each")
    _check_stage(places, name)
    if n > 1:
        _check_gaps(places, name)
    mask, value = _nothing(n, frames)
    for column, feature in enumerate((X, Z)):
        mask[:, frame, feature] = True
        value[:, frame, feature] = places[:, column]
    return Constraint(mask, value)


def _check_stage(places: Tensor, name: str) -> None:
    """Refuse places where nobody danced in training: dancers would leave them with a leap."""
    far = places.norm(dim=1)
    if (far > STAGE).any():
        x, z = places[int(far.argmax())].tolist()
        raise ValueError(
            f"{name} has the place ({x:g}, {z:g}), {far.max():.1f} m from the middle of the stage; "
            f"choose places within {STAGE:g} m, where the training dances are"
        )


def _check_gaps(places: Tensor, name: str) -> None:
    """Refuse two bodies in one place."""
    gaps = torch.cdist(places, places).fill_diagonal_(math.inf).min(1)
    k = int(gaps.values.argmin())
    if gaps.values[k] < CLOSE:
        raise ValueError(
            f"{name} has dancers {k} and {int(gaps.indices[k])} {gaps.values[k]:.2f} m apart, one "
            f"body in the other; place them at least {CLOSE:g} m apart"
        )


def _nothing(n: int, frames: int) -> tuple[Tensor, Tensor]:
    mask = torch.zeros(n, frames, TCDIFFPP.dim, dtype=torch.bool)
    return mask, torch.zeros(mask.shape)


def _dancer(k, n: int) -> int:
    try:
        if 0 <= (number := operator.index(k)) < n:
            return number
    except TypeError:  # no whole number
        pass
    raise ValueError(f"dancer={k!r} must be a whole number in 0 ... {n - 1}")


def _numbers(rows, width: int, name: str) -> Tensor:
    try:
        table = torch.as_tensor([[float(v) for v in row] for row in rows], dtype=torch.float32)
    except (TypeError, ValueError):
        raise ValueError(f"{name}={rows!r} must be rows of {width} numbers") from None
    if table.ndim != 2 or table.shape[1] != width or not table.isfinite().all():
        raise ValueError(f"{name}={rows!r} must be rows of {width} finite numbers")
    return table
