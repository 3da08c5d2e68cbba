"""The exercises of the lessons, each with a specification that checks an answer.

    EXERCISES["04.1"].judge(answer)   # a Verdict: open, wrong and why, or right

An answer is compared with the right one, on cases that bring out the usual mistakes, or, where many
answers are right, tested for what it must achieve.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import torch

from dancediff.diffusion.schedule import cosine_abar, q_sample
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_rot6d, rot6d_to_matrix
from dancediff.music.features import BEATS, FPS

OPEN, WRONG, RIGHT = "○", "✗", "✓"


@dataclass(frozen=True)
class Verdict:
    """What a check found: one of OPEN, WRONG, RIGHT, and a sentence."""

    mark: str
    text: str = ""

    def __str__(self) -> str:
        return f"{self.mark} {self.text}"


@dataclass(frozen=True)
class Exercise:
    """A task with its specification.

    ``spec`` is the right answer: a value to compare with, or a function that is called, like the
    reader's, on each of ``cases()``. With ``accepts`` many answers are right: it is called with
    what the reader's function made of a case, and with the case, and says what is wrong, or "".
    """

    title: str
    spec: object
    hint: str
    cases: Callable[[], list[tuple]] = lambda: [()]
    accepts: Callable | None = None

    def judge(self, answer) -> Verdict:
        """Compare an answer with the specification; may raise what the answer raises."""
        if _unanswered(answer):
            return Verdict(OPEN, "not attempted yet")
        if not callable(self.spec):
            return self._compare(answer, self.spec, "")
        if not callable(answer):
            return Verdict(WRONG, f"expected a function, got {type(answer).__name__}")
        for case in self.cases():
            verdict = self._try(answer, case)
            if verdict.mark is not RIGHT:
                return verdict
        return Verdict(RIGHT, self.title)

    def _try(self, answer, case: tuple) -> Verdict:
        got = answer(*copies(case))
        if _unanswered(got):
            return Verdict(OPEN, "not attempted yet")
        if self.accepts is None:
            return self._compare(got, self.spec(*copies(case)), f" for {_brief(case)}")
        wrong = self.accepts(got, *case)
        return self._wrong(wrong) if wrong else Verdict(RIGHT, self.title)

    def _compare(self, got, want, where: str) -> Verdict:
        if isinstance(want, dict):
            return self._compare_dicts(got, want)
        if not isinstance(got, torch.Tensor | np.ndarray | float | int | np.generic | list | tuple):
            return self._wrong(f"type {type(got).__name__}, expected {type(want).__name__}")
        a, b = torch.as_tensor(got).double(), torch.as_tensor(want).double()
        if a.shape != b.shape:
            return self._wrong(f"shape {tuple(a.shape)}, expected {tuple(b.shape)}{where}")
        if not torch.isfinite(a).all():
            return self._wrong(f"some of your numbers are not finite{where}")
        if not torch.allclose(a, b, rtol=1e-3, atol=1e-4):
            return self._wrong(f"yours {_numbers(a)}, expected {_numbers(b)}{where}")
        return Verdict(RIGHT, self.title)

    def _compare_dicts(self, got, want: dict) -> Verdict:
        if not isinstance(got, dict) or set(got) != set(want):
            return self._wrong(f"expected a dict with the keys {', '.join(map(repr, want))}")
        if any(_unanswered(value) for value in got.values()):
            return Verdict(OPEN, "not attempted yet")
        off = [key for key in want if got[key] != want[key]]
        if off:
            return self._wrong(f"yours says {off[0]!r}: {got[off[0]]}, expected {want[off[0]]}")
        return Verdict(RIGHT, self.title)

    def _wrong(self, text: str) -> Verdict:
        return Verdict(WRONG, f"{text}\n   hint: {self.hint}")


def _unanswered(answer) -> bool:
    return answer is None or answer is Ellipsis or answer is NotImplemented


def copies(case: tuple) -> tuple:
    """A case whose tensors an answer may spoil."""
    return tuple(v.clone() if isinstance(v, torch.Tensor) else v for v in case)


def _numbers(x: torch.Tensor) -> str:
    flat = x.flatten()
    text = ", ".join(f"{v:.4g}" for v in flat[:6].tolist())
    return f"[{text}{', …' if len(flat) > 6 else ''}]"


def _brief(case: tuple) -> str:
    return ", ".join(
        f"a tensor {tuple(v.shape)}" if isinstance(v, torch.Tensor) else f"{v!r}" for v in case
    )


# ---------------------------------------------------------------------------------- the exercises
def _tempo(M):
    return 60 * FPS / float(np.median(np.diff(np.flatnonzero(np.asarray(M)[:, BEATS.start] > 0.5))))


def _tempo_cases() -> list[tuple]:
    steady, gap = torch.zeros(300, 35), torch.zeros(300, 35)
    steady[7::15, BEATS] = 1  # 120 beats a minute
    gap[7::20, BEATS] = 1  # 90, and the tracker has missed two
    gap[[67, 187], BEATS] = 0
    return [(steady,), (gap,)]


def _rotation_cases() -> list[tuple]:
    R = axis_angle_to_matrix(torch.tensor([[0.3, -1.1, 0.4], [0.0, 2.0, 1.0]]))
    d6 = matrix_to_rot6d(R)
    stretched = d6 * torch.tensor([2.0, 2, 2, 0.5, 0.5, 0.5])
    bent = stretched + 0.3 * stretched[..., [3, 4, 5, 0, 1, 2]]  # the rows are no longer square
    return [(d6,), (stretched,), (bent,)]


def _x0_from(x_t, eps, t, abar):
    return (x_t - (1 - abar[t]).sqrt() * eps) / abar[t].sqrt()


def _x0_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    abar = cosine_abar(1000)
    x_0, eps = (torch.randn(2, 3, 4, generator=draw, dtype=torch.float64) for _ in range(2))
    return [(q_sample(x_0, t, abar, eps), eps, t, abar) for t in (0, 250, 800)]


def _leaks(train, test):
    return sum(any(a == b and abs(s - t) < 150 for b, t in train) for a, s in test)


def _leaks_cases() -> list[tuple]:
    grid = [(take, start) for take in "abc" for start in range(0, 451, 75)]
    by_take = ([w for w in grid if w[0] != "b"], [w for w in grid if w[0] == "b"])
    apart = ([("a", 0), ("b", 150)], [("a", 150), ("b", 0), ("c", 0)])  # they touch, no more
    return [(grid[::2], grid[1::2]), by_take, apart, ([("a", 100), ("a", 130)], [("a", 0)])]


def _dances() -> list[tuple]:
    from dancediff.data.choreographer import choreograph

    grid = np.arange(0.3, 6, 0.5)
    return [(choreograph(grid, dancers=2, seed=seed, seconds=6)[0],) for seed in (1, 2)]


def _stand_still(dance):
    return replace(dance, pose=0 * dance.pose + dance.pose[:, :1], root=0 * dance.root)


def _fools_pfc(got, dance) -> str:
    from dancediff.metrics.physical import pfc
    from dancediff.metrics.rhythm import beat_alignment
    from dancediff.motion.motion import Motion

    if not isinstance(got, Motion):
        return f"type {type(got).__name__}, expected a Motion"
    if got.root.shape != dance.root.shape:
        return f"shape {tuple(got.root.shape)} of the root, expected {tuple(dance.root.shape)}"
    beats = np.arange(0.3, 6, 0.5)
    for name, metric in (
        ("PFC", pfc),
        ("BAS", lambda joints: beat_alignment(joints, beats)),
    ):
        mine, its = metric(got.joints()), metric(dance.joints())
        if not mine <= its / 2:
            return f"your {name} is {mine:.3g}, expected at most half of the dance's {its:.3g}"
    return ""


EXERCISES = {
    "00.1": Exercise(
        "a seed names a dance",
        {"same seed again": True, "another seed": False, "another song": False},
        "a seed fixes the noise a dance starts from; noise, song and settings fix the rest",
    ),
    "01.1": Exercise(
        "six numbers to a rotation",
        rot6d_to_matrix,
        "rows: make the first one unit length, take its share out of the second, make that unit "
        "length too; the third is their cross product, in this order",
        _rotation_cases,
    ),
    "02.1": Exercise(
        "beats per minute",
        _tempo,
        f"column 34 marks beats at {FPS} frames a second; the tracker may miss a beat, so take "
        "the median of the gaps, not their mean",
        _tempo_cases,
    ),
    "03.1": Exercise(
        "find the leak",
        _leaks,
        "two windows share a frame when they are of one take and their starts differ by less than "
        "150, to either side; count each test window once",
        _leaks_cases,
    ),
    "04.1": Exercise(
        "undo the noise",
        _x0_from,
        "solve x_t = √ᾱ x_0 + √(1-ᾱ) ε for x_0, with ᾱ = abar[t]; mind both roots",
        _x0_cases,
    ),
    "13.1": Exercise(
        "make a metric lie",
        _stand_still,
        "PFC multiplies the root's acceleration with how far the feet travel: what if nobody "
        "travels? And BAS needs moments of rest between movements",
        _dances,
        _fools_pfc,
    ),
}
