"""The exercises of the lessons, each with a specification that checks an answer.

EXERCISES["04.1"].judge(answer)   # a Verdict: open, wrong and why, or right
"""

import tomllib
from importlib import import_module
from pathlib import Path

from dancediff.exercises.exercise import OPEN, RIGHT, WRONG, Exercise, Verdict, copies

_TEXTS = tomllib.loads((Path(__file__).parent / "exercises.toml").read_text(encoding="utf-8"))
_SPECS: dict[str, dict] = {}
for _lesson in range(1, 14):  # lesson 00 has predictions only
    _SPECS |= import_module(f"dancediff.exercises.lesson_{_lesson:02d}").SPECS
EXERCISES = {key: Exercise(**text, **_SPECS.get(key, {})) for key, text in _TEXTS.items()}

__all__ = ["EXERCISES", "OPEN", "RIGHT", "WRONG", "Exercise", "Verdict", "copies"]
