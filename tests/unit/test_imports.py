"""The library's parts stand in one order, and `import dancediff` is light."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

SOURCE = Path(__file__).parents[2] / "src" / "dancediff"
ORDER = [
    *["axes", "music", "motion", "data", "diffusion", "metrics", "nn", "tcdiffpp", "lodge"],
    *["baselines", "training", "viz", "export", "hub", "nb", "cli"],
]
HEAVY = ["torch", "librosa", "matplotlib", "ipywidgets", "pythreejs", "av"]


def part_of(path: Path) -> str:
    return path.relative_to(SOURCE).parts[0].removesuffix(".py")


def imports(tree: ast.AST):
    """Modules of this package imported at the top level of a file."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield node.module
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


@pytest.mark.parametrize(
    "path", sorted(SOURCE.rglob("*.py")), ids=lambda p: str(p.relative_to(SOURCE))
)
def test_imports_point_one_way(path):
    own = part_of(path)
    if own == "__init__":
        pytest.skip("the package itself only names homes")
    assert own in ORDER
    for module in imports(ast.parse(path.read_text(encoding="utf-8"))):
        parts = module.split(".")
        if parts[0] == "dancediff" and len(parts) > 1 and parts[1] != own:
            assert ORDER.index(parts[1]) < ORDER.index(own), f"{path.name} imports {module}"


@pytest.mark.parametrize("module", ["librosa", "matplotlib", "ipywidgets", "pythreejs", "av"])
def test_slow_libraries_are_imported_lazily(module):
    for path in SOURCE.rglob("*.py"):
        tops = {m.split(".")[0] for m in imports(ast.parse(path.read_text(encoding="utf-8")))}
        assert module not in tops, f"{path} imports {module} at the top"


def test_import_dancediff_is_light():
    code = f"import sys, dancediff; print([m for m in {HEAVY} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_public_names_resolve():
    import dancediff

    for name in dancediff.__all__:
        if name != "play":  # needs the notebooks extra
            assert getattr(dancediff, name) is not None
    with pytest.raises(AttributeError, match="nothing"):
        dancediff.nothing  # noqa: B018
