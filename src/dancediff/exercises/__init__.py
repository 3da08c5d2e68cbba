"""The exercises of the lessons, each with a specification that checks an answer.

EXERCISES["04.1"].judge(answer)   # a Verdict: open, wrong and why, or right
"""

from dancediff.exercises import foundations, group_dance, long_dance, measures
from dancediff.exercises.exercise import OPEN, RIGHT, WRONG, Exercise, Verdict, copies

EXERCISES = (
    foundations.EXERCISES | group_dance.EXERCISES | long_dance.EXERCISES | measures.EXERCISES
)

__all__ = ["EXERCISES", "OPEN", "RIGHT", "WRONG", "Exercise", "Verdict", "copies"]
