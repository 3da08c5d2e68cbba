"""The exercises of the lessons, each with a specification that checks an answer.

EXERCISES["04.1"].judge(answer)   # a Verdict: open, wrong and why, or right
"""

from importlib import import_module

from dancediff.exercises.exercise import OPEN, RIGHT, WRONG, Exercise, Verdict, copies

LESSONS = 14
EXERCISES: dict[str, Exercise] = {}
for _lesson in range(LESSONS):
    EXERCISES |= import_module(f"dancediff.exercises.lesson_{_lesson:02d}").EXERCISES

__all__ = ["EXERCISES", "OPEN", "RIGHT", "WRONG", "Exercise", "Verdict", "copies"]
