"""The library's parts stand in one order, and `import dancediff` is light."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "dancediff"
ORDER = [
    *["atomic", "axes", "lookup", "genre", "music", "motion", "data", "diffusion", "metrics", "nn"],
    *["extensions", "generation", "papers", "training", "viz", "export", "hub", "exercises"],
    *["grading", "nb", "cli"],
]
PICTURES = {"viz", "export"}  # methods may reach for these when they are called
HEAVY = ["torch", "librosa", "matplotlib", "ipywidgets", "pythreejs", "av"]
SETTLING = {"extensions", "generation", "papers"}  # still being taken apart
FILES = sorted(SOURCE.rglob("*.py"))


def part_of(path: Path) -> str:
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def imports(tree: ast.AST, lazy: bool = False):
    """Every imported module of a file, and whether it is imported inside a function only."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are written in full"
            whole = node.module == "dancediff"  # `from dancediff import hub`
            for name in node.names if whole else [None]:
                yield f"dancediff.{name.name}" if whole else node.module, lazy
        elif isinstance(node, ast.Import):
            yield from ((name.name, lazy) for name in node.names)
        else:
            inside = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            yield from imports(node, lazy or inside)


def wrong_imports(own: str, text: str) -> list[str]:
    """What a module of the part ``own`` imports although it must not."""
    wrong = []
    for module, lazy in imports(ast.parse(text)):
        package, part = [*module.split("."), ""][:2]
        if package != "dancediff" or part in ("", "__version__", own):
            continue
        if part in PICTURES:
            allowed = lazy or own in ("nb", "cli", *PICTURES)
        else:
            allowed = ORDER.index(part) < ORDER.index(own) or {part, own} <= SETTLING
        if not allowed:
            wrong.append(module)
    return wrong


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(SOURCE)))
def test_imports_point_one_way(path):
    own = part_of(path)
    if own == "__init__":
        pytest.skip("the package itself only names homes")
    assert own in ORDER
    assert wrong_imports(own, path.read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("own", "text", "wrong"),
    [
        ("nn", "from dancediff.motion import Motion\nimport dancediff.axes\nimport torch", 0),
        ("motion", "from dancediff.papers.tcdiffpp.model import TCDiffPP", 1),
        ("motion", "from dancediff import hub", 1),
        ("motion", "try:\n    import dancediff.nn\nexcept ImportError:\n    pass", 1),
        ("motion", "def save():\n    from dancediff.hub import load", 1),
        ("motion", "def save():\n    from dancediff.viz.plots import save_filmstrip", 0),
        ("training", "from dancediff.viz.plots import plot_losses", 1),
        ("hub", "from dancediff import __version__", 0),
    ],
)
def test_the_rule_notices(own, text, wrong):
    assert len(wrong_imports(own, text)) == wrong


@pytest.mark.parametrize("module", ["librosa", "matplotlib", "ipywidgets", "pythreejs", "av"])
def test_slow_libraries_are_imported_lazily(module):
    for path in FILES:
        found = imports(ast.parse(path.read_text(encoding="utf-8")))
        tops = {name.split(".")[0] for name, lazy in found if not lazy}
        assert module not in tops, f"{path} imports {module} at the top"


def loaded_after(statement: str) -> str:
    code = f"import sys\n{statement}\nprint([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.strip()


def test_import_dancediff_is_light():
    assert loaded_after("import dancediff; dir(dancediff)") == "[]"
    assert loaded_after("import dancediff.cli") == "[]"


def test_names_bring_only_what_they_need():
    assert loaded_after("from dancediff import Music, Motion, load") == "['torch']"


def test_public_names_resolve():
    import dancediff

    for name in dancediff.__all__:
        if name == "play":
            pytest.importorskip("pythreejs")
        assert getattr(dancediff, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        dancediff.nothing  # noqa: B018


@pytest.mark.parametrize("own, wanted", [(None, "5000"), ("7", "7")])
def test_torchs_threads_do_not_wait_for_ever(own, wanted):
    """On a busy machine threads that spin without end make a dance five times as slow."""
    env = {name: value for name, value in os.environ.items() if name != "GOMP_SPINCOUNT"}
    env |= {"GOMP_SPINCOUNT": own} if own else {}
    code = "import dancediff, os; print(os.environ['GOMP_SPINCOUNT'])"
    found = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=False
    )
    assert found.stdout.strip() == wanted, found.stderr
