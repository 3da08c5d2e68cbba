"""An exercise and how an answer to it is judged.

Read first: `dancediff.nb`, which calls it.

An answer is compared with the right one, on cases that bring out the usual mistakes, or, where many
answers are right, tested for what it must achieve.
"""

import copy
import inspect
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

OPEN, WRONG, RIGHT = "○", "✗", "✓"
COPY_FIRST = "   hint: work on a copy (of a tensor: x.clone()); others need it as it was"
SHOWN = 6  # numbers of an answer in a verdict


@dataclass(frozen=True)
class Verdict:
    """What a check found: one of OPEN, WRONG, RIGHT, and a sentence.

    ``more`` is for who is wrong a second time: it names a part of a prediction that is wrong.
    """

    mark: str
    text: str = ""
    more: str = ""

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
        try:
            wrong = self.accepts(got, *case)
        except Exception as err:  # of another kind than the text asks for
            wrong = f"what you return, {_kind(got)}, cannot be read as the text asks: {err}"
        return self._wrong(wrong) if wrong else Verdict(RIGHT, self.title)

    def _compare(self, got, want, where: str) -> Verdict:
        if isinstance(want, dict):
            return self._compare_dicts(got, want)
        try:
            wrong = _unlike(got, want)
        except (TypeError, ValueError) as err:
            wrong = f"{_kind(got)} that is not all numbers, or ragged: {err}"
        return self._wrong(wrong + where) if wrong else Verdict(RIGHT, self.title)

    def _compare_dicts(self, got, want: dict) -> Verdict:
        if not isinstance(got, dict) or set(got) != set(want):
            return self._wrong(f"expected a dict with the keys {', '.join(map(repr, want))}")
        missing = [key for key in want if _unanswered(got[key])]
        if missing:
            some = "not attempted yet"
            if len(missing) < len(want):
                some = f"{len(missing)} of {len(want)} have no answer yet, first {missing[0]!r}"
            return Verdict(OPEN, some)
        for key, right in want.items():
            if other := _other_kind(got[key], right):
                return self._wrong(f"{key!r}: {got[key]!r} {other}")
        off = [key for key in want if got[key] != want[key]]
        if off:
            verdict = self._wrong(f"{len(want) - len(off)} of {len(want)} are right")
            return replace(verdict, more=f"look again at {off[0]!r}")
        return Verdict(RIGHT, self.title)

    def _wrong(self, text: str) -> Verdict:
        return Verdict(WRONG, f"{text}\n   hint: {self.hint}")


def _unlike(got, want) -> str:
    """What is wrong with numbers that should be others, or "".

    >>> _unlike([1.0, 2.0], [1.0, 3.0])
    'yours [1, 2], expected [1, 3], first difference at [1]'
    """
    if not isinstance(got, torch.Tensor | np.ndarray | float | int | np.generic | list | tuple):
        return f"type {type(got).__name__}, expected {type(want).__name__}"
    a, b = torch.as_tensor(got).double(), torch.as_tensor(want).double()
    if a.shape != b.shape:
        return f"shape {tuple(a.shape)}, expected {tuple(b.shape)}"
    if not torch.isfinite(a).all():
        return "some of your numbers are not finite"
    off = ~torch.isclose(a, b, rtol=1e-3, atol=1e-4)
    if not off.any():
        return ""
    first = off.nonzero()[0].tolist()
    at = f", first difference at {first}" if first else ""
    k = int(off.flatten().nonzero()[0])
    return f"yours {_numbers(a, k)}, expected {_numbers(b, k)}{at}"


def _other_kind(got, want) -> str:
    """What is wrong with the kind of an answer to one part of a prediction, or "".

    >>> _other_kind("2", 2), _other_kind(2.0, 2)
    ('is a text, expected a number without quotation marks', '')
    """
    kind = "True or False" if isinstance(want, bool) else "a number"
    if isinstance(got, str):
        return f"is a text, expected {kind} without quotation marks"
    if not isinstance(got, int | float | np.generic):
        return f"is a {type(got).__name__}, expected {kind}"
    truth = isinstance(got, bool | np.bool_)
    return f"is no number, expected {kind}" if truth and not isinstance(want, bool) else ""


def _unanswered(answer) -> bool:
    return answer is None or answer is Ellipsis or answer is NotImplemented


def copies(case: tuple) -> tuple:
    """A case that an answer may spoil."""
    return tuple(v.clone() if isinstance(v, torch.Tensor) else copy.deepcopy(v) for v in case)


def _same(a, b) -> bool:
    """Whether two arguments hold the same values, down to each number.

    >>> _same([torch.ones(2)], [torch.ones(2)]), _same([torch.ones(2)], [torch.zeros(2)])
    (True, False)
    >>> _same(torch.tensor(float("nan")), torch.tensor(float("nan")))     # a number that is missing
    True
    """
    if type(a) is not type(b):
        return False
    if isinstance(a, torch.Tensor | np.ndarray):
        if a.shape != b.shape:
            return False
        return bool(((a == b) | ((a != a) & (b != b))).all())  # noqa: PLR0124 - nan, as before
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
    name = type(v).__name__
    return f"{'an' if name[0] in 'aeiou' else 'a'} {name}"


def _name(v) -> str:
    if inspect.isfunction(v):  # where it lies in memory tells nobody anything
        return v.__name__.strip("_")
    if isinstance(v, list) and len(v) > SHOWN and isinstance(v[0], int):
        return f"[{', '.join(map(str, v[:3]))}, …, {v[-1]}]"
    return _kind(v) if _is_large(v) else f"{v!r}"


def _is_large(v) -> bool:
    """Whether what a case holds is, or has in it, a tensor or an array of several axes.

    >>> _is_large([{"W": torch.ones(2)}]), _is_large({0: {"energy": 0.5}})
    (True, False)
    """
    if isinstance(v, dict):
        v = list(v.values())
    if isinstance(v, list):
        return any(map(_is_large, v))
    return isinstance(v, torch.Tensor) or (isinstance(v, np.ndarray) and v.ndim > 1)
