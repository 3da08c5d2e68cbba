"""`python -m dancediff.nb grade`: what a teacher types."""

import argparse
import io
import sys
from functools import partial
from pathlib import Path

from dancediff.atomic import atomic_write
from dancediff.grading.marks import grade, stored
from dancediff.grading.replay import replayed
from dancediff.grading.tables import csv_text, table


def main(arguments: list[str]) -> int:
    """Print who solved what, and write it to a file; 2 when there is nothing to grade."""
    parser = argparse.ArgumentParser(prog="python -m dancediff.nb grade", description=__doc__)
    parser.add_argument("folder", help="a folder a student, each with lessons")
    parser.add_argument(
        "--again",
        action="store_true",
        help="judge the answers again; runs the students' code, a process a notebook",
    )
    parser.add_argument("--seconds", type=float, default=60, help="an answer may take (60)")
    parser.add_argument(
        "--csv", type=Path, metavar="FILE", help="write the marks, a line a student"
    )
    options = parser.parse_args(arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):  # a Windows code page has no ✓
        sys.stdout.reconfigure(errors="replace")
    if not options.seconds > 0:
        parser.error(f"--seconds {options.seconds:g} must be more than 0")
    try:
        read = partial(replayed, seconds=options.seconds) if options.again else stored
        rows = grade(options.folder, read)
        print(table(rows), flush=True)  # first: a CSV that cannot be written costs no marks
        if options.csv:
            with atomic_write(options.csv) as part:
                part.write_text(csv_text(rows), encoding="utf-8-sig")  # as Excel reads it
    except (OSError, ValueError) as err:
        print(err, file=sys.stderr)
        return 2
    return 0
