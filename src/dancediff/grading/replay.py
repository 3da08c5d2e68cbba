"""The answers of a notebook, judged again: for who does not trust what is stored in it.

Read first: `dancediff.grading.marks`.

The students' code runs in a process of its own, which may crash or hang; it is not locked in, so
run it where strangers' code may run. Of the cells up to a check these are run: a cell tagged
"exercise" as it is, of any other the imports, the definitions and the constants.
"""

import ast
import contextlib
import faulthandler
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from dancediff.exercises import WRONG, judge
from dancediff.grading.marks import checks, read_book

HANGS, CRASHES = "∞", "!"
_CHILD = "import sys; from dancediff.grading import replay; replay.main(*sys.argv[1:])"


def replayed(path: Path, seconds: float = 60) -> dict[str, str]:
    """The mark of every exercise that a notebook checks, each answer judged again.

    An answer that takes longer than ``seconds`` has the mark HANGS, one that ends the process
    CRASHES; those after it are judged in a new process.

    Raises: what `read_book` raises; RuntimeError when no process can be started.
    """
    wanted = [exercise for _, exercise, _ in checks(read_book(path))]
    marks: dict[str, str] = {}
    with TemporaryDirectory() as folder:
        while len(marks) < len(set(wanted)):
            found = _in_a_process(path.resolve(), Path(folder), seconds, list(marks))
            if not found:
                raise RuntimeError("Python could not be started to judge the answers")
            marks |= found
    return {exercise: marks[exercise] for exercise in wanted}


def _in_a_process(path: Path, folder: Path, seconds: float, done: list[str]) -> dict[str, str]:
    said = folder / "said"
    said.write_text("", encoding="utf-8")
    subprocess.run(
        [sys.executable, "-c", _CHILD, str(path), str(said), str(seconds), *done],
        cwd=folder,
        env=os.environ | {"MPLBACKEND": "Agg"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        check=False,
    )
    found: dict[str, str] = {}
    for line in said.read_text(encoding="utf-8", errors="replace").splitlines():
        if line.startswith("{"):
            found |= json.loads(line)
        elif line.startswith("Timeout") and found:  # what faulthandler says before it ends us
            found[list(found)[-1]] = HANGS
    return found


def judge_cells(book: dict, done: list[str]):
    """Run what answers need, and yield (exercise, None) before and its mark after each check."""
    space: dict = {"__name__": "lesson"}
    failed: set[str] = set()
    last = 0
    for k, exercise, name in checks(book):
        cells, last = book["cells"][last : k + 1], k + 1
        if exercise in done:  # later answers may need what is defined here
            _run(cells, space, failed, only_plain=True)
            continue
        yield exercise, None
        _run(cells, space, failed)
        yield exercise, WRONG if name in failed else judge(exercise, space.get(name)).mark


def _run(cells: list[dict], space: dict, failed: set[str], *, only_plain: bool = False) -> None:
    """Run cells, and keep in ``failed`` the names that an answer tried in vain to define."""
    for cell in cells:
        if cell["cell_type"] != "code":
            continue
        answer, text = _is_answer(cell), "".join(cell["source"])
        try:
            body = _parsed(text)
        except (SyntaxError, ValueError):
            if answer:
                failed.update(re.findall(r"\w+", text))
            continue
        for part in body:
            if not (_is_plain(part) or (answer and not only_plain)):
                continue
            try:
                exec(compile(ast.Module([part], []), "lesson", "exec"), space)
                failed -= _defined(part)
            except Exception:  # what only tries the answer, or needs other cells, may fail
                if answer:
                    failed |= _defined(part)


def _parsed(text: str) -> list[ast.stmt]:
    """The statements of a cell, without lines for IPython.

    A line that begins with % may be the rest of a division, so nothing is left out that is Python.

    >>> [ast.unparse(part) for part in _parsed("%time 3\\nx = (7\\n  % 4)")]
    ['x = 7 % 4']
    """
    for shell in ("", r"^[%!].*"):
        with contextlib.suppress(SyntaxError, ValueError):
            return ast.parse(re.sub(shell, "", text, flags=re.MULTILINE)).body
    return ast.parse(re.sub(r"^[ \t]*[%!].*", "", text, flags=re.MULTILINE)).body


def _defined(part: ast.stmt) -> set[str]:
    """The names that a statement defines.

    >>> sorted(_defined(ast.parse("def f(x): return x").body[0]))
    ['f']
    """
    if isinstance(part, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
        return {part.name}
    names = (node for node in ast.walk(part) if isinstance(node, ast.Name))
    return {node.id for node in names if isinstance(node.ctx, ast.Store)}


def _is_answer(cell: dict) -> bool:
    return "exercise" in cell["metadata"].get("tags", [])


def _is_plain(part: ast.stmt) -> bool:
    """Imports, definitions and constants.

    >>> [_is_plain(part) for part in ast.parse("import os; gap = 2.2; x = f(gap); f(x)").body]
    [True, True, False, False]
    """
    if isinstance(part, ast.Assign):
        try:
            ast.literal_eval(part.value)
        except (ValueError, TypeError):
            return False
        return True
    return isinstance(part, ast.Import | ast.ImportFrom | ast.FunctionDef | ast.ClassDef)


def main(path: str, said: str, seconds: str, *done: str) -> None:
    """Judge in this process, which is ended where an answer takes too long."""
    with Path(said).open("a", encoding="utf-8", buffering=1) as out:
        faulthandler.dump_traceback_later(float(seconds), exit=True, file=out)
        for exercise, mark in judge_cells(read_book(Path(path)), list(done)):
            if mark is None:
                faulthandler.dump_traceback_later(float(seconds), exit=True, file=out)
            else:
                faulthandler.cancel_dump_traceback_later()
            out.write(json.dumps({exercise: mark or CRASHES}) + "\n")
    os._exit(0)  # whatever threads a student has left
