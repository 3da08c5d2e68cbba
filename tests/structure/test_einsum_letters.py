"""Axes of `rearrange` and `einsum` are letters of the house, or explained on top of the file.

Names of two letters and more explain themselves.
"""

import ast
import re
from pathlib import Path

import pytest

import dancediff.axes
from places import SOURCE

HOUSE = set("bnfdmjlhs")


EINSUM = re.compile(r"[a-z]+(,[a-z]+)*->[a-z]*")
REARRANGE = re.compile(r"[\w .()]+->[\w .()]+")


def letters(tree: ast.AST) -> set[str]:
    """Axes of one letter in the patterns of a file."""
    found: set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if EINSUM.fullmatch(node.value):
                found |= set(re.findall(r"[a-z]", node.value))
            elif REARRANGE.fullmatch(node.value):
                found |= set(re.findall(r"\b[a-z]\b", node.value))
    return found


def unexplained(text: str) -> set[str]:
    """Letters in patterns that neither the house nor the file's table of symbols knows."""
    tree = ast.parse(text)
    table = re.search(r"\(axes:(.*?)\)$", ast.get_docstring(tree) or "", re.DOTALL | re.MULTILINE)
    return letters(tree) - HOUSE - set(re.findall(r"\b[a-z]\b", table[1] if table else ""))


def path_in_source(path: Path) -> str:
    """Many files are called model.py."""
    return path.relative_to(SOURCE).as_posix()


def test_axes_are_explained():
    files = {path_in_source(p): p.read_text(encoding="utf-8") for p in SOURCE.rglob("*.py")}
    found = {name: unexplained(text) for name, text in files.items()}
    assert len(found) > 400
    assert {name: unknown for name, unknown in found.items() if unknown} == {}
    assert set(re.findall(r"(?:^| · )\s*([a-z]) ", dancediff.axes.__doc__, re.MULTILINE)) >= HOUSE


PATTERNS = [("b (z f) d -> b z f d", {"z"}), ("bq,qn->bn", {"q"})]


@pytest.mark.parametrize("pattern, unknown", PATTERNS)
def test_a_letter_that_nobody_explains_is_noticed(pattern, unknown):
    code = f'y = change(x, "{pattern}")'
    assert unexplained(code) == unknown
    assert unexplained(f'"""Symbols (axes: z chunks · q queries)"""\n{code}') == set()


RANGE = re.compile(r"\b(arange|linspace)\(")


def times_called_t(tree: ast.AST) -> list[int]:
    """Lines in which `t` runs over something, or over a range: a frame, a sample or seconds."""
    lines = []
    for node in ast.walk(tree):
        if isinstance(node, ast.For | ast.comprehension):
            target = node.target
        elif isinstance(node, ast.Assign) and RANGE.search(ast.unparse(node.value)):
            target = ast.Tuple(node.targets)
        else:
            continue
        names = [n for n in ast.walk(target) if isinstance(n, ast.Name) and n.id == "t"]
        lines += [name.lineno for name in names]
    return lines


def test_t_is_neither_a_frame_nor_seconds():
    parts = ("diffusion", "training", "papers")
    parts += ("exercises/lesson_04.py", "exercises/lesson_06.py")
    steps = {SOURCE / part for part in parts}  # there t is a step of the diffusion
    files = [p for p in SOURCE.rglob("*.py") if steps.isdisjoint({p, *p.parents})]
    found = {
        path_in_source(p): times_called_t(ast.parse(p.read_text(encoding="utf-8"))) for p in files
    }
    assert len(found) > 300
    assert {name: lines for name, lines in found.items() if lines} == {}


CODE = {
    "for t in range(9): pass": 1,
    "x = [p[d, t] for d, t in jumps]": 1,
    "t = np.arange(9) / rate": 1,
    "t = np.linspace(0, 1, steps)[None]": 1,
    "s, t = at(a), at(b)": 0,
    "for sec in range(9): t = f(sec)": 0,
}


@pytest.mark.parametrize("code", CODE)
def test_a_time_called_t_is_noticed(code):
    assert len(times_called_t(ast.parse(code))) == CODE[code]
