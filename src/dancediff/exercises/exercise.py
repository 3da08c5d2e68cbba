"""An exercise and how an answer to it is judged.

An answer is compared with the right one, on cases that bring out the usual mistakes, or, where many
answers are right, tested for what it must achieve.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import torch

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
