"""The documentation site holds everything, draws its formulas and fetches nothing."""

import json
import re
import subprocess
import sys
from pathlib import Path

import pytest

from places import ROOT

sys.path.insert(0, str(ROOT / "docs" / "site"))

from docstrings import markdown
from gather import for_site, gather, lesson

MATHS = re.compile(r"\$\$(.+?)\$\$|(?<![\\$])\$(?!\s)([^$\n]+?)(?<!\s)\$(?!\d)", re.DOTALL)
CODE = re.compile(r"^```(?!{).*?^```|``.+?``|`[^`\n]*`", re.DOTALL | re.MULTILINE)
FETCHED = re.compile(r"<(?:link|script|img|iframe|source)\b[^>]*(?:src|href)=[\"'](?:https?:)?//")


@pytest.fixture(scope="module")
def pages(tmp_path_factory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("site")
    found = gather(folder)
    texts = [name for name in found if name.endswith((".md", ".ipynb"))]
    return {name: (folder / name).read_text(encoding="utf-8") for name in texts}


def in_contents(pages: dict[str, str]) -> set[str]:
    """Names of pages that a table of contents leads to, without suffix."""
    found = set()
    for page, text in pages.items():
        for entries in re.findall(r"^```{toctree}\n(.*?)^```", text, re.DOTALL | re.MULTILINE):
            for line in entries.splitlines():
                name = re.sub(r".*<(.+)>", r"\1", line).strip()
                if name and not name.startswith(":"):
                    found.add((Path(page).parent / name).as_posix())
    return found


def test_everything_is_in_the_contents(pages):
    modules = {
        ".".join(path.relative_to(ROOT / "src").with_suffix("").parts).removesuffix(".__init__")
        for path in (ROOT / "src" / "dancediff").rglob("*.py")
    }
    expected = {f"api/{name}" for name in modules if "._" not in name}
    documents = [*ROOT.glob("docs/*.md"), *ROOT.glob("docs/results/*.md")]
    expected |= {path.relative_to(ROOT).with_suffix("").as_posix() for path in documents}
    expected -= {"docs/index"}
    lessons = {f"notebooks/{path.stem}" for path in (ROOT / "notebooks").glob("*.ipynb")}
    gathered = {name.rsplit(".", 1)[0] for name in pages}
    contents = in_contents(pages)
    assert expected | lessons <= gathered
    assert expected <= contents and "notebooks/*" in contents
    missing = {name for name in contents if name not in gathered | {"notebooks/*", "self"}}
    assert missing == set()


def test_a_docstring_becomes_markdown():
    text = markdown(
        "Half of `x`, if x < 1.\n\n$$y = \\frac x2$$\n\nSymbols (axes: f frames)\n"
        "    x    what goes in   (f,)\n    y|z  what comes\n         out            (f,)\n\n"
        "Shapes: x (f,) -> (f,).\nRaises: ValueError for\nnothing.\n\n>>> half(2)\n1",
        {"x": "there.x"}.get,
    )
    assert text == (
        "Half of {py:obj}`x <there.x>`, if x \\< 1.\n\n$$\ny = \\frac x2\n$$\n\n:Axes: f frames\n\n"
        "| symbol | meaning | shape, unit |\n| --- | --- | --- |\n"
        "| `x` | what goes in | (f,) |\n| `y\\|z` | what comes out | (f,) |\n\n"
        ":Shapes: x (f,) -> (f,).\n:Raises: ValueError for\n    nothing.\n\n"
        "```pycon\n>>> half(2)\n1\n```"
    )


def test_links_of_documents_fit_the_site():
    text = (
        "[a](../src/dancediff/nn/conditioning.py) [b](../notebooks/solutions) [c](../LICENSE)\n"
        "`dancediff.nn.conditioning.FiLM` `dancediff.nowhere`\n"
        "```\n[a](../src/dancediff/hub.py)\n```\n"
    )
    names = {"dancediff.nn.conditioning.FiLM"}
    written, linked = for_site(text, ROOT / "docs" / "x.md", names, known={"docs/data.md"})
    assert written == (
        "[a](../api/dancediff.nn.conditioning.md) b [c](../LICENSE)\n"
        "{py:obj}`dancediff.nn.conditioning.FiLM` `dancediff.nowhere`\n"
        "```\n[a](../src/dancediff/hub.py)\n```\n"
    )
    assert linked == [ROOT / "LICENSE"]


def test_every_formula_can_be_drawn(pages):
    pytest.importorskip("sphinx", reason="Sphinx is not installed; `make docs` does that")
    pytest.importorskip("latex2mathml", reason="latex2mathml is not installed; see `make docs`")
    from mathml import to_mathml

    texts = [CODE.sub("", text) for name, text in pages.items() if name.endswith(".md")]
    formulas = [block or inline for text in texts for block, inline in MATHS.findall(text)]
    assert len(formulas) > 200
    for formula in formulas:
        assert to_mathml(formula).startswith("<math")
    with pytest.raises(ValueError, match="nonsense"):
        to_mathml(r"\nonsense{x}")


@pytest.mark.slow
def test_a_small_site_is_built_without_a_warning(pages, tmp_path):
    for package in ("sphinx", "myst_nb", "furo", "ziamath"):
        pytest.importorskip(package, reason=f"{package} is not installed; `make docs` does that")
    source, out = tmp_path / "source", tmp_path / "out"
    (source / "api").mkdir(parents=True)
    page = "api/dancediff.diffusion.schedule.md"
    text = re.sub(r"\[(notebook \d\d)\]\(.*?\)", r"\1", pages[page])
    (source / page).write_text(text, encoding="utf-8")
    (source / "index.md").write_text(
        "# Site\n\n```{toctree}\napi/dancediff.diffusion.schedule\n```\n"
    )
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-c", str(ROOT / "docs")]
    done = subprocess.run(
        [*command, str(source), str(out)], capture_output=True, text=True, timeout=110, check=False
    )
    assert done.returncode == 0, done.stderr[-2000:]
    built = (out / page).with_suffix(".html").read_text(encoding="utf-8")
    assert built.count("<math") > 5 and "$$" not in built and "[source]" in built
    assert fetched(out) == {}


def test_built_pages_fetch_nothing():
    out = ROOT / "out" / "docs"
    if not (out / "index.html").exists():
        pytest.skip("the site is not built; `make docs` does that")
    assert fetched(out) == {}


def fetched(folder: Path) -> dict[str, str]:
    """What pages and style sheets would load from elsewhere."""
    found = {}
    for path in [*folder.rglob("*.html"), *folder.rglob("*.css")]:
        text = path.read_text(encoding="utf-8")
        if hit := FETCHED.search(text) or re.search(r"url\([\"']?(https?:)?//", text):
            found[path.name] = hit[0]
    return found


def test_links_in_pictures_lead_to_pages():
    html = ['<a href="07_who_stands_where.ipynb" title="FP"></a>', "<p>07_who.ipynb</p>"]
    cell = {"cell_type": "code", "source": "", "outputs": [{"data": {"text/html": html}}]}
    shown = json.loads(lesson(json.dumps({"cells": [cell]})))["cells"][0]["outputs"][0]["data"]
    assert '<a href="07_who_stands_where.html" title' in shown["text/html"]
    assert "<p>07_who.ipynb</p>" in shown["text/html"]
