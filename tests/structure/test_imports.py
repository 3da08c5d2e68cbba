"""The library's parts stand in one order, and `import dancediff` is light."""

import ast
import os
import subprocess
import sys

import pytest

from places import SOURCE

ORDER = [  # lowest first; a module imports its own part and lower ones
    *[
        "atomic",
        "arrays",
        "axes",
        "backends",
        "lookup",
        "own",
        "threads",
        "genre",
        "music",
        "motion",
        "data",
        "diffusion",
        "nn",
        "autoregression",
    ],
    *["metrics", "papers", "extensions", "generation", "viz", "export", "io", "training", "hub"],
    *["live_dance", "user_study", "bench", "exercises", "grading", "nb", "cli"],
]
HEAVY = ["torch", "librosa", "matplotlib", "ipywidgets", "pythreejs", "av"]
FILES = sorted(SOURCE.rglob("*.py"))

MODULES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__"): path
    for path in FILES
    if path != SOURCE / "__init__.py"  # runs before all others, and names where public names are
}


def imports(tree: ast.AST, lazy: bool = False):
    """Every imported module of a file, and whether it is imported inside a function only."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "imports are written in full"
            for name in node.names:  # `from dancediff.viz import stage` imports a module, too
                whole = f"{node.module}.{name.name}"
                yield whole if whole.removeprefix("dancediff.") in MODULES else node.module, lazy
        elif isinstance(node, ast.Import):
            yield from ((name.name, lazy) for name in node.names)
        else:
            inside = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
            yield from imports(node, lazy or inside)


def ours(text: str) -> set[str]:
    """The modules of dancediff that a file imports anywhere, without "dancediff."."""
    found = {name for name, _ in imports(ast.parse(text))}
    return {n.removeprefix("dancediff.") for n in found if n.startswith("dancediff.")} & {*MODULES}


def graph() -> dict[str, set[str]]:
    return {name: ours(path.read_text(encoding="utf-8")) for name, path in MODULES.items()}


def circle(graph: dict[str, set[str]]) -> list[str]:
    """Modules that import each other in a ring, or nothing when there is no ring."""
    left = {name: set(found) - {name} for name, found in graph.items()}
    while free := [name for name, found in left.items() if not found & left.keys()]:
        for name in free:
            del left[name]
    ring: list[str] = []
    name = next(iter(left), None)
    while name is not None and name not in ring:
        ring.append(name)
        name = next(other for other in sorted(left[name]) if other in left)
    return ring[ring.index(name) :] if ring else []


def wrong_imports(own: str, text: str) -> list[str]:
    """What the module ``own`` imports although it must not."""
    part, *inside = own.split(".")
    wrong = []
    for other in ours(text):
        theirs, *folder = other.split(".")
        if theirs != part:
            allowed = ORDER.index(theirs) < ORDER.index(part)
        else:  # papers know nothing of each other
            allowed = part != "papers" or folder[0] == inside[0]
        if not allowed:
            wrong.append(other)
    return wrong


@pytest.mark.parametrize("own", MODULES)
def test_imports_point_one_way(own):
    assert own.split(".")[0] in ORDER
    assert wrong_imports(own, MODULES[own].read_text(encoding="utf-8")) == []


@pytest.mark.parametrize(
    ("own", "text", "wrong"),
    [
        ("nn.conditioning", "from dancediff.motion.motion import Motion\nimport dancediff.axes", 0),
        ("motion.ik", "from dancediff.papers.tcdiffpp.model import TCDiffPP", 1),
        ("motion.ik", "from dancediff import hub", 1),
        (
            "motion.ik",
            "try:\n    import dancediff.nn.conditioning\nexcept ImportError:\n    pass",
            1,
        ),
        ("motion.ik", "def save():\n    from dancediff.viz.plots import save_filmstrip", 1),
        ("training.loop", "from dancediff.viz.plots import plot_energy", 0),
        ("papers.lodge.style", "from dancediff.papers.lodge import losses", 0),
        ("papers.edge.model", "from dancediff.generation import request", 1),
        ("hub", "from dancediff import __version__", 0),
    ],
)
def test_the_rule_notices(own, text, wrong):
    assert len(wrong_imports(own, text)) == wrong


def test_no_module_imports_itself_through_others():
    """Imports inside functions count, too: moved to the top they would fail."""
    assert circle(graph()) == []


def test_a_circle_is_found():
    chain = {"a": {"b"}, "b": {"c"}, "c": set(), "d": {"a"}}
    assert circle(chain) == []
    assert sorted(circle(chain | {"c": {"a"}})) == ["a", "b", "c"]


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


def test_type_checkers_see_the_public_names():
    """What is imported for them is what is looked up at run time, and py.typed lets them look."""
    import dancediff

    tree = ast.parse((SOURCE / "__init__.py").read_text(encoding="utf-8"))
    block = next(n for n in tree.body if isinstance(n, ast.If))
    seen = {a.name: n.module for n in block.body for a in n.names}
    assert seen == dancediff._HOME and {*seen, "__version__"} == {*dancediff.__all__}
    assert (SOURCE / "py.typed").is_file()


def printed(code: str, own: str | None = None) -> str:
    """What a new process prints whose GOMP_SPINCOUNT is ``own``."""
    env = {name: value for name, value in os.environ.items() if name != "GOMP_SPINCOUNT"}
    env |= {"GOMP_SPINCOUNT": own} if own else {}
    done = subprocess.run(
        [sys.executable, "-c", code], env=env, capture_output=True, text=True, check=True
    )
    return done.stdout.strip().splitlines()[-1]


def test_an_import_sets_no_variable_of_the_process():
    parts = "dancediff, dancediff.hub, dancediff.nb, dancediff.training.run, dancediff.cli"
    code = f"import os; before = {{**os.environ}}; import {parts}; print(os.environ == before)"
    assert printed(code) == "True"


@pytest.mark.parametrize("own, wanted", [(None, "5000"), ("7", "7")])
def test_torchs_threads_do_not_wait_for_ever(own, wanted):
    """On a busy machine threads that spin without end make a dance five times as slow."""
    code = "import os, sys; from dancediff.cli import main; main(['--version']); "
    code += "print(os.environ['GOMP_SPINCOUNT'], 'torch' in sys.modules)"
    assert printed(code, own) == f"{wanted} False"
