"""The exercises of the lessons, each with a specification that checks an answer.

judge("04.1", answer)   # a Verdict: open, wrong and why, or right
"""

import tomllib
from importlib import import_module
from pathlib import Path

from dancediff.exercises.exercise import OPEN, RIGHT, WRONG, Exercise, Verdict, copies

_TEXTS = tomllib.loads((Path(__file__).parent / "exercises.toml").read_text(encoding="utf-8"))
_SPECS: dict[str, dict] = {}
for _lesson in range(17):
    _SPECS |= import_module(f"dancediff.exercises.lesson_{_lesson:02d}").SPECS
EXERCISES = {key: Exercise(**text, **_SPECS.get(key, {})) for key, text in _TEXTS.items()}

__all__ = ["EXERCISES", "OPEN", "RIGHT", "WRONG", "Exercise", "Verdict", "copies", "judge"]


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
