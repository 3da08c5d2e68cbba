"""What the lessons share: set-up, shape tables, exercises that check themselves.

    from dancediff import nb
    nb.setup(4)                       # the only set-up cell of a lesson
    nb.shapes(x_t=x_t)                # names, shapes, types
    nb.check("04.1", x0_from)         # ○ open   ✗ wrong, and where to look   ✓ right
    nb.solution("04.1")

A check never raises, so an unfinished exercise never stops a notebook.
"""

import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from dancediff.diffusion.schedule import cosine_abar, q_sample
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_rot6d, rot6d_to_matrix
from dancediff.music.features import BEATS, FPS

OPEN, WRONG, RIGHT = "○", "✗", "✓"
_lesson: dict = {"number": None, "start": 0.0}
_status: dict[str, str] = {}


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
    reader's, on each of ``cases()``.
    """

    title: str
    spec: object
    hint: str
    cases: Callable[[], list[tuple]] = lambda: [()]

    def judge(self, answer) -> Verdict:
        """Compare an answer with the specification; may raise what the answer raises."""
        if _unanswered(answer):
            return Verdict(OPEN, "not attempted yet")
        if not callable(self.spec):
            return self._compare(answer, self.spec, "")
        if not callable(answer):
            return Verdict(WRONG, f"expected a function, got {type(answer).__name__}")
        for case in self.cases():
            got, want = answer(*_copies(case)), self.spec(*_copies(case))
            if _unanswered(got):
                return Verdict(OPEN, "not attempted yet")
            verdict = self._compare(got, want, f" for {_brief(case)}")
            if verdict.mark is not RIGHT:
                return verdict
        return Verdict(RIGHT, self.title)

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


def _copies(case: tuple) -> tuple:
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
}


# ------------------------------------------------------------------------- what notebooks call
def setup(lesson: int) -> None:
    """Start a lesson: seeds, figure style, clock. Shows nothing.

    Raises: ValueError for a negative number.
    """
    if lesson < 0:
        raise ValueError(f"lesson={lesson} must not be negative")
    _lesson.update(number=lesson, start=time.perf_counter())
    for key in [key for key in _status if key.startswith(f"{lesson:02d}.")]:
        del _status[key]
    torch.manual_seed(lesson)
    import matplotlib as mpl

    mpl.rcParams.update({"figure.dpi": 100, "font.size": 9, "axes.titlesize": 10})
    try:
        shell = get_ipython()  # type: ignore[name-defined]
    except NameError:
        return
    shell.run_line_magic("matplotlib", "inline")
    shell.run_line_magic("config", "InlineBackend.figure_formats = ['png']")


def real_data(name: str) -> Path | None:
    """The folder of a data set that cannot come with this project, or None if it is not here.

    Looked for in the folder that ``DANCEDIFF_DATA`` names, else in ``../shared/data``.

    >>> real_data("no such data set") is None
    True
    """
    project = Path(__file__).resolve().parents[2]
    root = Path(os.environ.get("DANCEDIFF_DATA") or project.parent / "shared" / "data")
    return root / name if (root / name).is_dir() else None


def shapes(**tensors) -> None:
    """Print name, shape and type of tensors, one a line.

    >>> shapes(x=torch.zeros(2, 3), beats=np.zeros(4))
    x      (2, 3)  float32
    beats  (4,)    float64
    """
    rows = [(name, str(tuple(x.shape)), str(x.dtype)) for name, x in tensors.items()]
    wide = [max((len(row[c]) for row in rows), default=0) for c in range(2)]
    for name, shape, kind in rows:
        _say(f"{name:{wide[0]}}  {shape:{wide[1]}}  {kind.removeprefix('torch.')}")


def same(mine, library, name: str) -> None:
    """Say that your result is the library's.

    Raises: AssertionError when it is not; this line is a test.

    >>> same(torch.ones(2), torch.ones(2), "torch.ones")
    ✓ same as torch.ones
    """
    torch.testing.assert_close(
        torch.as_tensor(mine), torch.as_tensor(library), rtol=1e-4, atol=1e-5
    )
    _say(f"{RIGHT} same as {name}")


def judge(exercise: str, answer) -> Verdict:
    """What `check` would print, as a Verdict; whatever the answer does, this does not raise.

    >>> print(judge("00.1", ...))
    ○ not attempted yet
    """
    if exercise not in EXERCISES:
        return Verdict(
            WRONG, f"there is no exercise {exercise!r}; there are {', '.join(EXERCISES)}"
        )
    try:
        return EXERCISES[exercise].judge(answer)
    except NotImplementedError:
        return Verdict(OPEN, "not attempted yet")
    except Exception as err:
        hint = EXERCISES[exercise].hint
        return Verdict(WRONG, f"your code raised {type(err).__name__}: {err}\n   hint: {hint}")


def check(exercise: str, answer=None) -> None:
    """Check an answer and print the verdict; never raises."""
    verdict = judge(exercise, answer)
    _status[exercise] = verdict.mark
    _say(f"{verdict.mark} {exercise} {verdict.text}")


def show(exercise: str, answer=None):
    """Your numbers beside the expected ones, as a Figure (None while there is nothing to show)."""
    task = EXERCISES.get(exercise)
    if task is None or not callable(task.spec) or not callable(answer):
        _say(f"{OPEN} {exercise} has nothing to show yet")
        return None
    case = task.cases()[-1]
    try:
        yours = answer(*_copies(case))
        bars = [
            torch.as_tensor(v).double().flatten()[:24].numpy() for v in (yours, task.spec(*case))
        ]
    except Exception as err:
        _say(f"{WRONG} {exercise} raised {type(err).__name__}: {err}")
        return None
    return _bar_pair(bars, f"{exercise}: {task.title}")


def _bar_pair(bars, title: str):
    from matplotlib.figure import Figure

    from dancediff.viz.palette import dancer_color
    from dancediff.viz.style import bare, set_title

    figure = Figure(figsize=(6.4, 2.2), layout="constrained")
    ax = figure.subplots()
    for k, (values, name) in enumerate(zip(bars, ("yours", "expected"), strict=True)):
        x = np.arange(len(values)) + 0.4 * k
        ax.bar(x, values, width=0.38, color=dancer_color(k), label=name)
    ax.legend(fontsize=8, frameon=False)
    set_title(bare(ax), title)
    return figure


def solution(exercise: str) -> None:
    """Print the solution of an exercise with its explanation."""
    _say(solution_text(exercise) or f"no solution file for {exercise!r}; see notebooks/solutions")


def solution_text(exercise: str) -> str:
    """The part of ``solutions/NN.py`` that belongs to an exercise; empty if there is none."""
    name = f"{exercise.split('.', maxsplit=1)[0]}.py"
    project = Path(__file__).resolve().parents[2] / "notebooks"
    for folder in (Path("solutions"), Path("notebooks/solutions"), project / "solutions"):
        if (folder / name).is_file():
            parts = (folder / name).read_text(encoding="utf-8").split("\n# %% ")
            return next((p.partition("\n")[2].strip() for p in parts if p.startswith(exercise)), "")
    return ""


def report() -> None:
    """Print the exercises of this lesson with their marks, and how long it took."""
    number = _lesson["number"]
    for key, task in EXERCISES.items():
        if number is not None and key.startswith(f"{number:02d}."):
            _say(f"{_status.get(key, OPEN)} {key} {task.title}")
    _say(f"{time.perf_counter() - _lesson['start']:.0f} s since the set-up cell")


def _say(text: str) -> None:
    print(text)  # a lesson talks
