"""An exercise and how an answer to it is judged.

Read first: `dancediff.nb`, which calls it.

An answer is compared with the right one, on cases that bring out the usual mistakes, or, where many
answers are right, tested for what it must achieve.
"""

import copy
import inspect
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

OPEN, WRONG, RIGHT = "○", "✗", "✓"
COPY_FIRST = "   hint: work on a copy (of a tensor: x.clone()); others need it as it was"
SHOWN = 6  # numbers of an answer in a verdict


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
    A function must leave what it is given as it was.
    """

    title: str
    spec: Any
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
        given = copies(case)
        got = answer(*given)
        if _unanswered(got):
            return Verdict(OPEN, "not attempted yet")
        changed = [old for old, new in zip(case, given, strict=True) if not _same(old, new)]
        if changed:
            return Verdict(WRONG, f"changes what it is given, {_kind(changed[0])}\n{COPY_FIRST}")
        if self.accepts is None:
            where = f" for {', '.join(map(_name, case))}"
            return self._compare(got, self.spec(*copies(case)), where)
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
        off = ~torch.isclose(a, b, rtol=1e-3, atol=1e-4)
        if off.any():
            first = off.nonzero()[0].tolist()
            at = f", first difference at {first}" if first else ""
            k = int(off.flatten().nonzero()[0])
            return self._wrong(f"yours {_numbers(a, k)}, expected {_numbers(b, k)}{at}{where}")
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
    """A case that an answer may spoil."""
    return tuple(v.clone() if isinstance(v, torch.Tensor) else copy.deepcopy(v) for v in case)


def _same(a, b) -> bool:
    """Whether two arguments hold the same values, down to each number.

    >>> _same([torch.ones(2)], [torch.ones(2)]), _same([torch.ones(2)], [torch.zeros(2)])
    (True, False)
    """
    if type(a) is not type(b):
        return False
    if isinstance(a, torch.Tensor | np.ndarray):
        return a.shape == b.shape and bool((a == b).all())
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(_same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(_same, a, b))
    return _same(vars(a), vars(b)) if hasattr(a, "__dict__") else a == b


def _numbers(x: torch.Tensor, k: int) -> str:
    """Some numbers around the k-th.

    >>> _numbers(torch.arange(20), 9)
    '[…, 7, 8, 9, 10, 11, 12, …]'
    """
    flat = x.flatten().tolist()
    first = max(0, min(k - 2, len(flat) - SHOWN))
    shown = [f"{v:.4g}" for v in flat[first : first + SHOWN]]
    before, behind = ["…"] * (first > 0), ["…"] * (first + SHOWN < len(flat))
    return f"[{', '.join(before + shown + behind)}]"


def _kind(v) -> str:
    if isinstance(v, torch.Tensor | np.ndarray):
        return f"{'a tensor' if isinstance(v, torch.Tensor) else 'an array'} {tuple(v.shape)}"
    return f"a {type(v).__name__}"


def _name(v) -> str:
    if inspect.isfunction(v):  # where it lies in memory tells nobody anything
        return v.__name__.strip("_")
    return _kind(v) if isinstance(v, torch.Tensor) else f"{v!r}"
