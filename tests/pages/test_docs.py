"""What the documents say is there, is there."""

import re
from importlib import import_module

import pytest

from places import ROOT

PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/*.md"), *ROOT.glob("docs/results/*.md")])


def links(text: str) -> list[str]:
    found = re.findall(r"\]\(([^)\s]+)\)", text)
    return [link.split("#")[0] for link in found if not link.startswith(("http", "#"))]


@pytest.mark.parametrize("page", PAGES, ids=lambda p: str(p.relative_to(ROOT)))
def test_links_lead_somewhere(page):
    missing = [
        link
        for link in links(page.read_text(encoding="utf-8"))
        if not (page.parent / link).exists()
    ]
    assert missing == []


def test_every_symbol_is_in_the_code():
    text = (ROOT / "docs" / "symbols.md").read_text(encoding="utf-8")
    names = re.findall(r"`(dancediff\.[\w.]+)`", text)
    assert len(names) > 20
    for name in names:
        module, attribute = name.rsplit(".", 1)
        assert hasattr(import_module(module), attribute), name


def test_every_named_test_and_source_file_exists():
    folders = ("tests", "src/dancediff", "benchmarks", "docs/site")
    there = {p.name for folder in folders for p in (ROOT / folder).rglob("*.py")}
    for page in PAGES:
        for name in re.findall(r"`(?:[\w/]+/)?(\w+\.py)`", page.read_text(encoding="utf-8")):
            assert name in there, f"{page.name} names {name}"


@pytest.mark.slow
def test_the_lines_of_the_readme_run(tmp_path, monkeypatch):
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    assert len(blocks) == 1
    monkeypatch.chdir(tmp_path)
    names: dict = {}
    exec(compile(blocks[0], "README.md", "exec"), names)
    assert names["dance"].num_dancers == 3 and names["dance"].num_frames == 150
    assert names["dd"].Motion.load("dance.npz").num_frames == 150
