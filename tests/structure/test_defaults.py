"""Every default of a request stands once: in its dataclass, or in the presets."""

import ast

import pytest

from dancediff.generation.presets import PRESETS
from dancediff.generation.request import REQUESTS, default_of
from places import SOURCE

ITS_PLACE = {
    f"generation/{name}_request.py"
    for name in ("dance", "diffusion", "segmented", "tcdiffpp", "lodge", "autoregressive")
}
OF_OTHER_THINGS = {  # than a dance that a model makes; a seed is 0 wherever something is drawn
    "data/choreographer/choreograph.py::choreograph.dancers",
    *[  # zero is all steps, whatever a model asks for
        f"diffusion/{name}.sigma_min"
        for name in (
            "samplers.py::SamplerOptions",
            "samplers.py::sampling_times",
            "dpm_solver.py::logsnr_times",
        )
    ],
    "metrics/inputs.py::as_group.dancers",
}


def usual_values() -> dict[str, set]:
    """What each option is where nobody says otherwise, in any family and preset."""
    values: dict[str, set] = {}
    for family, request in REQUESTS.items():
        for name in request.names():
            usual = {default_of(family, name, preset) for preset in PRESETS}
            values.setdefault(name, set()).update(usual - {None})
    return values


def defaults(tree: ast.AST):
    """Every default in the source: where, of what, and its value if it is a plain one."""
    for node in ast.walk(tree):
        pairs = []
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            args, every = node.args, [*node.args.posonlyargs, *node.args.args]
            pairs = list(zip(every[::-1], args.defaults[::-1], strict=False))
            pairs += [
                (arg, value) for arg, value in zip(args.kwonlyargs, args.kw_defaults, strict=True)
            ]
            pairs = [(arg.arg, value) for arg, value in pairs]
        elif isinstance(node, ast.ClassDef):
            fields = [one for one in node.body if isinstance(one, ast.AnnAssign)]
            pairs = [(one.target.id, one.value) for one in fields]
        for name, value in pairs:
            if isinstance(value, ast.Constant) and value.value is not None:
                yield f"{node.name}.{name}", name, value.value


def written_twice(text: str) -> list[str]:
    usual = usual_values()
    return [
        where
        for where, name, value in defaults(ast.parse(text))
        if any(value == one and type(value) is type(one) for one in usual.get(name, ()))
    ]


def test_no_default_of_a_request_is_written_a_second_time():
    found = {
        f"{path.relative_to(SOURCE).as_posix()}::{where}"
        for path in sorted(SOURCE.rglob("*.py"))
        if path.relative_to(SOURCE).as_posix() not in ITS_PLACE
        for where in written_twice(path.read_text(encoding="utf-8"))
    }
    assert {one for one in found if one.rpartition(".")[2] != "seed"} == OF_OTHER_THINGS


@pytest.mark.parametrize(
    ("text", "found"),
    [
        ("def f(steps=8): pass", ["f.steps"]),
        ("def f(steps=13, *, eta=None): pass", []),
        ("class A:\n  soft: float = 1.0\n  other: float = 1.0", ["A.soft"]),
        ("def f(a, *, mirror=True): pass", ["f.mirror"]),
    ],
)
def test_the_rule_notices(text, found):
    assert written_twice(text) == found
