"""What `grade` found: a table to read, and one for a spreadsheet."""

import csv
import io

from dancediff.exercises import EXERCISES, OPEN, RIGHT, WRONG
from dancediff.grading.marks import NOT_RUN
from dancediff.grading.replay import CRASHES, HANGS

WORDS = {  # from the best to the worst
    RIGHT: "right",
    WRONG: "wrong",
    HANGS: "hangs",
    CRASHES: "crashes",
    OPEN: "open",
    NOT_RUN: "not run",
}


def table(rows: list[dict]) -> str:
    """What `grade` found, to read: a line a notebook, then how many solved each exercise.

    >>> print(table([{"file": "ann/04.ipynb", "marks": {"04.1": "✓", "04.2": "○"}}]))
    ann/04.ipynb  1 of 2  ✓ 04.1  ○ 04.2
    <BLANKLINE>
    04.1  solved in 1 of 1  undo the noise
    04.2  solved in 0 of 1  walk on
    <BLANKLINE>
    ✓ right  ○ open
    """
    wide = max(len(row["file"]) for row in rows)
    lines: list[str] = []
    tried: dict = {}
    for row in rows:
        if "failed" in row:
            lines.append(f"{row['file']:{wide}}  cannot be read: {row['failed']}")
            continue
        right = sum(mark == RIGHT for mark in row["marks"].values())
        each = "  ".join(f"{mark} {exercise}" for exercise, mark in row["marks"].items())
        lines.append(f"{row['file']:{wide}}  {right} of {len(row['marks'])}  {each}".rstrip())
        for exercise, mark in row["marks"].items():
            tried.setdefault(exercise, []).append(mark == RIGHT)
    seen = {m: w for m, w in WORDS.items() for row in rows if m in row.get("marks", {}).values()}
    lines.append("")
    for exercise in sorted(tried):
        title = EXERCISES[exercise].title if exercise in EXERCISES else "no exercise of the course"
        done = tried[exercise]
        lines.append(f"{exercise}  solved in {sum(done)} of {len(done)}  {title}")
    legend = "  ".join(f"{mark} {word}" for mark, word in seen.items())
    return "\n".join([*lines, "", legend])


def csv_text(rows: list[dict]) -> str:
    """What `grade` found, for a spreadsheet: a line a student, a column an exercise.

    A student is the first folder of a file's path, or a file that is in none. Where two notebooks
    have one exercise the better mark counts; what was not handed in is empty.

    >>> print(csv_text([{"file": "ann/04.ipynb", "marks": {"04.1": "✓", "04.2": "○"}}]), end="")
    student,right,of,04.1,04.2,cannot be read
    ann,1,2,right,open,
    """
    students: dict[str, dict[str, str]] = {}
    damaged: dict[str, list[str]] = {}
    order = list(WORDS)
    for row in rows:
        student = row["file"].replace("\\", "/").partition("/")[0].removesuffix(".ipynb")
        mine = students.setdefault(student, {})
        if "failed" in row:
            damaged.setdefault(student, []).append(row["file"])
        for exercise, mark in row.get("marks", {}).items():
            mine[exercise] = min(mark, mine.get(exercise, mark), key=order.index)
    columns = sorted({exercise for mine in students.values() for exercise in mine})
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["student", "right", "of", *columns, "cannot be read"])
    for student, mine in sorted(students.items()):
        right = sum(mark == RIGHT for mark in mine.values())
        words = [WORDS.get(mine.get(exercise, ""), "") for exercise in columns]
        writer.writerow([student, right, len(columns), *words, " ".join(damaged.get(student, ()))])
    return text.getvalue()
