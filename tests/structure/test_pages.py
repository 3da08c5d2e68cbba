"""Pages and lessons: as long as agreed, up to date with their numbers, true about the code."""

import ast
import doctest
import json
import re
import sys
from pydoc import locate

import pytest

from dancediff.extensions.registry import REGISTRY
from dancediff.generation.presets import PACKAGED, PAPER
from places import ROOT

sys.path.insert(0, str(ROOT / "docs" / "site"))

import dance_page
import tables

LOG = sorted((ROOT / "docs" / "log").glob("*.md"))
PAGES = [ROOT / "README.md", *tables.PAGES]
LESSONS = sorted((ROOT / "notebooks").glob("[0-9]*.ipynb"))
MOST_WORDS = 14_000


def prose(text: str) -> list[str]:
    """Words that somebody wrote: no tables, no code blocks, no targets of links.

    A word is what stands between spaces and holds a letter or a digit. Lines that start with a bar
    are tables; blocks that docs/site/tables.py writes are tables with what stands below them.

    >>> len(prose("# A page\\n\\nThree [short words](x.md).\\n\\n| a | b |\\n"))
    5
    """
    for block in (tables.BLOCK, tables.MAP, dance_page.MADE):
        text = block.sub("", text)
    text = re.sub(r"^```.*?^```[^\n]*$", "", text, flags=re.DOTALL | re.MULTILINE)
    text = "\n".join(line for line in text.splitlines() if not line.lstrip().startswith("|"))
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return [word for word in text.split() if re.search(r"\w", word)]


def test_pages_are_short_enough():
    words = {path.name: len(prose(path.read_text(encoding="utf-8"))) for path in PAGES}
    assert sum(words.values()) <= MOST_WORDS, words


@pytest.mark.parametrize("path", [*PAGES, *LOG], ids=lambda p: p.name)
def test_lines_are_wrapped(path):
    lines = path.read_text(encoding="utf-8").splitlines()
    assert [line for line in lines if len(line) > 100 and not line.startswith("|")] == []


@pytest.mark.parametrize("path", PAGES[1:], ids=lambda p: p.name)
def test_tables_are_those_of_the_numbers(path):
    text = path.read_text(encoding="utf-8")
    assert tables.written(text) == text, "run: python docs/site/tables.py"


def test_the_picture_is_that_of_the_registry():
    picture = dance_page.PICTURE.read_text(encoding="utf-8")
    assert picture == dance_page.picture(), "run: python docs/site/tables.py"
    assert len(picture) < 10_000


@pytest.mark.parametrize("family", dance_page.PAPERS)
def test_how_a_dance_is_made_names_all_options_and_additions(family):
    page = (ROOT / "docs" / "how_a_dance_is_made.md").read_text(encoding="utf-8")
    block = next(m[0] for m in dance_page.MADE.finditer(page) if m[2] == family)
    for preset in (PAPER, PACKAGED):
        for name, value in preset[family].items():
            assert (f"`{name}={value!r}`" in block) == dance_page.heard(name, family), name
    for one in REGISTRY.values():
        assert (f"[{one.name}]" in block) == one.packaged_in(family)


def test_every_addition_says_what_it_brings():
    names = [path.stem for path in tables.RESULTS.glob("extensions_*.json")]
    named = " ".join(row[0] for name in names for row in tables.load(name)["rows"])
    assert set(re.findall(r"`(\w+)`", named)) == set(REGISTRY)


def test_a_changed_number_is_noticed(tmp_path, monkeypatch):
    table = {"about": "Made.", "data": "synthetic", "command": "make x"}
    table |= {"columns": ["a"], "rows": [[[1.5, 1, 2]]]}
    (tmp_path / "x.json").write_text(json.dumps(table))
    monkeypatch.setattr(tables, "RESULTS", tmp_path)
    page = tables.written("<!-- table: x -->\n<!-- end -->\n")
    assert "| 1.5 [1, 2] |" in page and "Made. Data: synthetic. Made by `make x`." in page
    assert tables.written(page) == page
    table["command"] = "By hand."
    (tmp_path / "x.json").write_text(json.dumps(table))
    assert "Made. Data: synthetic. By hand." in tables.written(page)
    table["rows"] = [[1.6, 1]]
    (tmp_path / "x.json").write_text(json.dumps(table))
    with pytest.raises(ValueError, match="1 cells"):
        tables.written(page)
    del table["command"]
    (tmp_path / "x.json").write_text(json.dumps(table))
    with pytest.raises(ValueError, match=r"required .*'command'"):
        tables.written(page)


def test_all_numbers_are_shown_and_say_where_they_are_from():
    names = {path.stem for path in tables.RESULTS.glob("*.json")}
    assert names == tables.asked_for() and len(names) > 30
    for name in names:
        table = tables.load(name)
        assert table["data"]
        command = table["command"]  # typed, or a sentence
        if isinstance(command, str) and not command.startswith(tables.PROGRAMS):
            assert re.match(r"[A-Z].*\.$", command), name
        assert all(one.startswith(tables.PROGRAMS) for one in typed(table)), name


def typed(table: dict) -> list[str]:
    """The commands of a table; none if a sentence stands there instead."""
    command = table["command"]
    if isinstance(command, list):
        return command
    return [command] if command.startswith(tables.PROGRAMS) else []


SAID = {  # how the text of a table states an option of sampling
    "steps": r"(?<![\d,])(\d+) steps(?! of)",
    "autoguidance": r"autoguidance (\d+(?:\.\d+)?)",
    "guidance": r"(?<!auto)guidance (\d+(?:\.\d+)?)",
}
MEASURES = {"bars.py": "tcdiffpp", "lodge_bars.py": "lodge"}  # programs that take --sampling


def options_missing(table: dict) -> list[str]:
    """Options that the text states, which are no defaults and stand in not all commands."""
    missing = []
    for command in typed(table):
        family = MEASURES.get(command.removeprefix("python benchmarks/").split()[0])
        for option, words in SAID.items():
            for said in re.findall(words, table["about"]) if family else []:
                given = f"--sampling.{option} {said}"
                if float(said) != PACKAGED[family][option] and f"{given} " not in f"{command} ":
                    missing.append(f"{given} in {command!r}")
    return missing


def test_a_command_has_the_options_that_its_table_states():
    for path in tables.RESULTS.glob("*.json"):
        assert options_missing(tables.load(path.stem)) == [], path.stem


@pytest.mark.parametrize(
    ("about", "options", "missing"),
    [
        ("20 steps.", "", 1),
        ("20 steps.", "--sampling.steps 20", 0),
        ("20 steps, autoguidance 2.2.", "--sampling.steps 20", 1),
        ("20 steps, autoguidance 2.2.", "--sampling.steps 20 --sampling.autoguidance 2.25", 1),
        ("8 steps, guidance 1, autoguidance 1.42.", "", 0),
        ("Guidance of 6,000 steps of training.", "", 0),
    ],
)
def test_a_missing_option_is_noticed(about, options, missing):
    command = f"python benchmarks/bars.py dances tcdiffpp held other {options}"
    assert len(options_missing({"about": about, "command": command})) == missing


@pytest.mark.parametrize("module", [dance_page, tables], ids=lambda module: module.__name__)
def test_examples_of_the_programs_hold(module):
    """They are no part of the package, whose examples pytest collects."""
    found = doctest.testmod(module)
    assert found.attempted > 0 and found.failed == 0


def test_several_commands_are_shown_to_copy():
    text, block = tables.made_by(["make x", "python a.py" + 20 * " --long"])
    assert text == "Made by:" and block[:3] == ["", "```sh", "make x"] and block[-1] == "```"
    assert all(len(line) <= 100 for line in "\n".join(block).splitlines())


def test_the_map_names_all_parts():
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    named = set(tables.MAP.search(text)[2].split())
    there = {p.stem for p in tables.SOURCE.iterdir() if not p.stem.startswith("__")}
    assert named == there - {"assets", "py"}


@pytest.mark.parametrize("path", [*PAGES, *LESSONS], ids=lambda p: p.name)
def test_names_of_the_code_exist(path):
    """``dancediff.x.y`` in backticks or quotes, and what code blocks import."""
    text = path.read_text(encoding="utf-8")
    if path in LESSONS:
        text = "\n".join(map(source, json.loads(text)["cells"]))
    names = re.findall(r"[`\"](dancediff(?:\.\w+)+)[`\"]", text)
    for module, imported in re.findall(r"from (dancediff[\w.]*) import ([\w, ]+)", text):
        names += [f"{module}.{name.split(' as ')[0].strip()}" for name in imported.split(",")]
    assert [name for name in names if locate(name) is None] == []


def source(cell: dict) -> str:
    return "".join(cell["source"])


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_what_a_lesson_stores_is_what_its_code_prints(path):
    """A stored "same as X" names the X of its cell: else the lesson must be run again."""
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        if cell["cell_type"] == "code":
            printed = "".join("".join(o.get("text", "")) for o in cell["outputs"])
            for name in re.findall(r"✓ same as (.+)", printed):
                assert any(re.fullmatch(said, name) for said in compared(source(cell))), name


def compared(code: str) -> list[str]:
    """The names given to ``nb.same``, as patterns: what an f-string puts in may be anything.

    >>> compared('nb.same(1, 1, "a.b"); nb.same(1, 1, f"x at {t}")')
    ['a\\\\.b', 'x\\\\ at\\\\ .*']
    """
    calls = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Call)]
    names = [call.args[2] for call in calls if ast.unparse(call.func) == "nb.same"]
    found = []
    for name in names:
        parts = name.values if isinstance(name, ast.JoinedStr) else [name]
        texts = (part.value if isinstance(part, ast.Constant) else None for part in parts)
        found.append("".join(".*" if text is None else re.escape(text) for text in texts))
    return found


def test_files_named_in_pages_exist():
    """Paths in backticks, from the root, from the package or from the choreographer."""
    bases = [
        ROOT,
        ROOT / "src" / "dancediff",
        ROOT / "src" / "dancediff" / "data" / "choreographer",
    ]
    pattern = r"`((?:\w+/)+\w+\.(?:py|toml|md|png))`"
    for path in PAGES:
        for name in re.findall(pattern, path.read_text(encoding="utf-8")):
            assert any((base / name).exists() for base in bases), f"{path.name} names {name}"
