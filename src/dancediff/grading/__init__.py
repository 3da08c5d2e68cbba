"""Who solved what: marks of lessons as they were run, or judged again; lessons with solutions.

python -m dancediff.nb grade FOLDER          # a folder a student, each with executed lessons
"""

from dancediff.grading.marks import NOT_RUN, checks, grade, marks
from dancediff.grading.replay import CRASHES, HANGS, replayed
from dancediff.grading.solved import open_then_solved, with_solutions
from dancediff.grading.tables import csv_text, table

__all__ = [
    "CRASHES",
    "HANGS",
    "NOT_RUN",
    "checks",
    "csv_text",
    "grade",
    "marks",
    "open_then_solved",
    "replayed",
    "table",
    "with_solutions",
]
