"""What the lessons share: set-up, shape tables, exercises that check themselves.

Read first: notebook 00.

    from dancediff import nb
    nb.setup(4)                       # the only set-up cell of a lesson
    nb.resume(4)                      # in its "start here" cells
    nb.shapes(x_t=x_t)                # names, shapes, types
    nb.check("04.1", x0_from)         # ○ open   ✗ wrong, and where to look   ✓ right
    nb.network("tcdiffpp_no_ssm")     # a small network, trained without a part
    nb.solution("04.1")

and for teachers, on the command line: ``python -m dancediff.nb grade FOLDER``.

A check never raises, so an unfinished exercise never stops a notebook.
"""

import os
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch

from dancediff.exercises import EXERCISES, OPEN, RIGHT, WRONG, copies, judge
from dancediff.exercises.solutions import solution_text

if TYPE_CHECKING:
    from dancediff.generation.pipeline import Pipeline

NETWORKS = Path(__file__).parent / "assets" / "lesson_networks"

_lesson: dict = {"number": None, "start": 0.0}
_status: dict[str, str] = {}


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
    from matplotlib.rcsetup import cycler

    from dancediff.viz.palette import DANCER_COLORS

    mpl.rcParams.update({"figure.dpi": 100, "font.size": 9, "axes.titlesize": 10})
    mpl.rcParams["axes.prop_cycle"] = cycler(color=list(DANCER_COLORS))
    try:
        shell = get_ipython()  # type: ignore[name-defined]
    except NameError:
        return
    shell.run_line_magic("matplotlib", "inline")
    shell.run_line_magic("config", "InlineBackend.figure_formats = ['png']")


def resume(lesson: int) -> None:
    """Begin a lesson in the middle: `setup`, unless this lesson is set up already."""
    if _lesson["number"] != lesson:
        setup(lesson)


def real_data(name: str) -> Path | None:
    """The folder of a data set that cannot come with this project, or None if it is not here.

    Looked for in the folder that ``DANCEDIFF_DATA`` names, else in ``../shared/data``.

    >>> real_data("no such data set") is None
    True
    """
    project = Path(__file__).resolve().parents[2]
    root = Path(os.environ.get("DANCEDIFF_DATA") or project.parent / "shared" / "data")
    return root / name if (root / name).is_dir() else None


def network(name: str) -> "Pipeline":
    """A small network of the course, complete or trained without a part; ``.model`` is the network.

    ``dancediff ablate configs/ablate_lessons.toml`` makes them, and ``ablate_lessons_lodge.toml``.

    Raises: ValueError that names them all.

    >>> network("tcdiffpp_no_ssm").config.without
    ('ssm',)
    """
    from dancediff import hub

    names = sorted(path.parent.name for path in NETWORKS.glob("*/config.json"))
    if name not in names:
        raise ValueError(f"name={name!r} is no network of the course; there are {', '.join(names)}")
    return hub.load(NETWORKS / name)


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
    mine, library = torch.as_tensor(mine), torch.as_tensor(library)
    torch.testing.assert_close(mine, library, rtol=1e-4, atol=1e-5, check_dtype=False)
    _say(f"{RIGHT} same as {name}")


def check(exercise: str, answer=None) -> None:
    """Check an answer and print the verdict; never raises.

    A wrong prediction is told how many of its parts are right, the second time also where to look.
    """
    verdict = judge(exercise, answer)
    again = _status.get(exercise) == WRONG
    _status[exercise] = verdict.mark
    _say(f"{verdict.mark} {exercise} {verdict.text}")
    if again and verdict.more:
        _say(f"   {verdict.more}")
    task = EXERCISES.get(exercise)
    if task and verdict.mark == WRONG and _has_numbers(task, answer) and not task.accepts:
        name = getattr(answer, "__name__", "your answer")
        _say(f'   nb.show("{exercise}", {name}) draws your numbers beside the expected ones')


def _has_numbers(task, answer) -> bool:
    return callable(task.spec) and callable(answer)


def answer(exercise: str, yours=None):
    """Your function if the check calls it right, else the course's own, for lessons that go on.

    Raises: ValueError for an exercise that does not exist, or that asks for no function.

    >>> answer("05.2")(torch.ones(2, 1, 3), torch.zeros(2, 1, 3)).item()      # moved together
    0.0
    """
    task = EXERCISES.get(exercise)
    if task is None or not callable(task.spec):
        raise ValueError(f"exercise={exercise!r} is no exercise that asks for a function")
    return yours if judge(exercise, yours).mark == RIGHT else task.spec


def show(exercise: str, answer=None):
    """Your numbers beside the expected ones, as a Figure; or None, and it says why.

    An answer that is judged by what it achieves has no such numbers: this says what the check says.
    """
    task, verdict = EXERCISES.get(exercise), judge(exercise, answer)
    if task is None or verdict.mark == OPEN or not _has_numbers(task, answer):
        _say(f"{verdict.mark} {exercise} has nothing to draw")
        return None
    if task.accepts:
        _say(f"{verdict.mark} {exercise} {verdict.text}")
        _say(f"   judged by what it achieves; nb.solution({exercise!r}) prints one way to do it")
        return None
    case = task.cases()[-1]
    try:
        yours = answer(*copies(case))
        bars = [
            torch.as_tensor(v).double().flatten()[:24].numpy() for v in (yours, task.spec(*case))
        ]
    except Exception as err:
        _say(f"{WRONG} {exercise} raised {type(err).__name__}: {err}")
        return None
    return _bar_pair(bars, f"{exercise}: {task.title}")


def _bar_pair(bars, title: str):
    from matplotlib.figure import Figure
    from matplotlib.ticker import MaxNLocator

    from dancediff.viz.palette import dancer_color
    from dancediff.viz.style import bare, set_legend, set_title

    figure = Figure(figsize=(6.4, 2.2), layout="constrained")
    ax = figure.subplots()
    for k, (values, name) in enumerate(zip(bars, ("yours", "expected"), strict=True)):
        x = np.arange(len(values)) + 0.4 * k - 0.2
        seen = np.isfinite(values)
        label = name if seen.all() else f"{name} ({(~seen).sum()} nan or infinite)"
        ax.bar(x, np.where(seen, values, np.nan), width=0.38, color=dancer_color(k), label=label)
    ax.set(xlabel="place in the result, flattened", ylabel="value")
    ax.xaxis.set_major_locator(MaxNLocator(integer=True, min_n_ticks=1))
    set_legend(ax, loc="center left", bbox_to_anchor=(1, 0.5))
    set_title(bare(ax), title)
    return figure


def solution(exercise: str) -> None:
    """Print the solution of an exercise with its explanation."""
    _say(solution_text(exercise) or f"no solution file for {exercise!r}; see notebooks/solutions")


def report() -> None:
    """Print the exercises of this lesson with their marks, and how long it took.

    What is solved has its title, which may give the answer away.
    """
    number = _lesson["number"]
    if number is None:
        _say("no lesson is set up; run the cell with nb.setup, and the checks again")
        return
    for key, task in EXERCISES.items():
        if key.startswith(f"{number:02d}."):
            mark = _status.get(key, OPEN)
            _say(f"{mark} {key} {task.title}" if mark == RIGHT else f"{mark} {key}")
    _say(f"{time.perf_counter() - _lesson['start']:.0f} s since the set-up cell")


def _say(text: str) -> None:
    print(text)  # a lesson talks


def main(arguments: list[str]) -> int:
    """``grade FOLDER``: print who solved what."""
    from dancediff.grading import command

    if arguments[:1] != ["grade"]:
        _say("usage: python -m dancediff.nb grade FOLDER [--again] [--csv FILE]")
        return 2
    return command.main(arguments[1:])


if __name__ == "__main__":
    import sys

    sys.exit(main(sys.argv[1:]))
