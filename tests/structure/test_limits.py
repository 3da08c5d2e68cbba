"""Limits that keep functions readable, counted in the source."""

import ast

import pytest

from code_lines import code_lines
from dancediff.generation.request import REQUESTS
from places import SOURCE

MOST_PARAMETERS = 8
MOST_LINES = 60  # of code: no docstring, no comments, no blank lines


def functions(tree: ast.AST, prefix: str = ""):
    """Every function with its dotted name, methods and inner functions included."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            name = f"{prefix}{node.name}"
            if not isinstance(node, ast.ClassDef):
                yield name, node
            yield from functions(node, f"{name}.")
        else:
            yield from functions(node, prefix)


def too_large(text: str) -> list[str]:
    """Names of functions with too many parameters or lines; constructors may have parameters."""
    found, lines = [], code_lines(text)
    for name, node in functions(ast.parse(text)):
        every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        every += [one for one in (node.args.vararg, node.args.kwarg) if one]
        given = [one for one in every if one.arg not in ("self", "cls")]
        body = set(range(node.lineno, node.end_lineno + 1)) & lines
        if ast.get_docstring(node):
            body -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
        many = len(given) > MOST_PARAMETERS and node.name not in ("__init__", "__new__")
        if many or len(body) > MOST_LINES:
            found.append(name)
    return found


def all_too_large() -> set[str]:
    return {
        f"{path.relative_to(SOURCE)}::{name}"
        for path in sorted(SOURCE.rglob("*.py"))
        for name in too_large(path.read_text(encoding="utf-8"))
    }


def test_functions_are_short_and_take_few_parameters():
    found = all_too_large()
    assert found == set(), "longer than 60 lines of code, or more than 8 parameters"


def test_nothing_assigns_to_what_is_frozen():
    """A request does not change after `resolve`, nor does any other frozen dataclass once built."""
    for path in sorted(SOURCE.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        built = {
            id(part)
            for name, node in functions(tree)
            if name.split(".")[-1] in ("__init__", "__post_init__")
            for part in ast.walk(node)
        }
        for node in ast.walk(tree):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "object.__setattr__":
                assert id(node) in built, f"{path}:{node.lineno} changes what is frozen"
    for request in REQUESTS.values():
        assert request.__dataclass_params__.frozen


@pytest.mark.parametrize(
    ("text", "beyond"),
    [
        ("def f(a, b, c, d, e, f, g, h): pass", 0),
        ("def f(a, b, c, d, e, f, g, h, i): pass", 1),
        ("def f(a, *b, c, d, e, f, g, h, **i): pass", 1),
        ("class A:\n  def __init__(self, a, b, c, d, e, f, g, h, i): pass", 0),
        ("class A:\n  def run(self, a, b, c, d, e, f, g, h): pass", 0),
        ("def f():\n  def g(a, b, c, d, e, f, g, h, i): pass", 1),
        ("def f():\n" + 59 * "  x = 1\n", 0),
        ("def f():\n" + 60 * "  x = 1\n", 1),
        ("def f():\n" + 50 * "  x = 1\n\n  # why\n", 0),
        ("def f():\n  '''" + 99 * "a\n" + "'''\n" + 59 * "  x = 1\n", 0),
    ],
)
def test_the_limits_notice(text, beyond):
    assert len(too_large(text)) == beyond
