"""Lessons that are read at one go: short cells, short sentences, and a picture soon."""

import ast
import json
import re

import pytest

from dancediff.exercises import EXERCISES
from dancediff.exercises.solutions import solution_text
from dancediff.generation.presets import PAPER
from dancediff.viz.panels import NOT_IN_PAPERS
from places import BOOKS, ROOT

LESSONS = sorted(BOOKS.glob("[0-9]*.ipynb"))
FIRST_PICTURE = 20  # lines of code up to it
CODE, WORDS, SENTENCE = 15, 120, 35  # lines of a cell, words of a text, words of a sentence
BUILDING = range(10, 23)  # lines of a solution that builds something


def cells(path):
    book = json.loads(path.read_text(encoding="utf-8"))
    return [cell | {"source": "".join(cell["source"])} for cell in book["cells"]]


def code_lines(code: str) -> int:
    """Lines to be read: no imports, no blank lines.

    >>> code_lines("import math\\n\\nx = (\\n    1\\n)")
    3
    """
    imports: set[int] = set()
    for node in ast.parse(code).body:
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports |= set(range(node.lineno, node.end_lineno + 1))
    lines = enumerate(code.splitlines(), 1)
    return sum(1 for number, line in lines if line.strip() and number not in imports)


def shown(text: str) -> str:
    """What is read as running text: no code, tables, formulas, and no hint that is folded away."""
    text = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<details>.*?</details>", "", text, flags=re.DOTALL)
    text = re.sub(r"\$\$.*?\$\$", "\n\n", text, flags=re.DOTALL)
    return "\n".join(line for line in text.splitlines() if not line.startswith("|"))


def sentences(text: str) -> list[int]:
    """Words of each sentence; an item of a list, or what stands before a colon, is one.

    >>> sentences("Two words. Then $a + b$ and `f(x, y)`: four.\\n\\n- an item")
    [2, 4, 1, 2]
    """
    text = re.sub(r"\$[^$\n]*\$|`[^`\n]*`", "x", shown(text))
    text = re.sub(r"\]\([^)]*\)|<[^>]*>", " ", text)
    found = []
    for part in re.split(r"\n\s*\n|\n(?=\s*(?:[-*>#]|\d+\.)\s)", text):
        if part.lstrip().startswith(("#", "⏱")):
            continue
        for sentence in re.split(r"(?<=[.!?:;])[\"”*)\]]*\s+", part.replace("\n", " ")):
            found.append(sum(1 for word in sentence.split() if re.search(r"\w", word)))
    return [count for count in found if count]


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_the_first_picture_comes_soon(path):
    read = 0
    for cell in cells(path):
        if cell["cell_type"] == "code":
            read += code_lines(cell["source"])
            if any("image/png" in output.get("data", {}) for output in cell["outputs"]):
                break
    else:
        pytest.fail("there is no picture")
    assert read <= FIRST_PICTURE


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_code_cells_are_short(path):
    code = [cell["source"] for cell in cells(path) if cell["cell_type"] == "code"]
    assert [one for one in code if code_lines(one) > CODE] == []


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_texts_are_short(path):
    texts = [cell["source"] for cell in cells(path) if cell["cell_type"] == "markdown"]
    assert [one for one in texts if len(shown(one).split()) > WORDS] == []


@pytest.mark.parametrize("path", [*LESSONS, ROOT / "README.md"], ids=lambda p: p.stem)
def test_sentences_are_short(path):
    texts = [path.read_text(encoding="utf-8")]
    if path in LESSONS:
        texts = [cell["source"] for cell in cells(path) if cell["cell_type"] == "markdown"]
    assert [one for one in texts if max(sentences(one), default=0) > SENTENCE] == []


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_a_slider_for_what_papers_set_says_what_they_take(path):
    """`panels.option` looks it up; a slider made by hand must be told."""
    takes: dict[str, set] = {}
    for preset in (PAPER["tcdiffpp"], PAPER["lodge"]):
        for name in preset.keys() - set(NOT_IN_PAPERS):
            takes.setdefault(name.replace("_", " "), set()).add(preset[name])
    for cell in cells(path):
        if cell["cell_type"] == "code":
            for call in filter(is_slider, ast.walk(ast.parse(cell["source"]))):
                told = {keyword.arg: ast.unparse(keyword.value) for keyword in call.keywords}
                label = call.args[3].value
                if label in takes:
                    assert float(told["paper"]) in takes[label], ast.unparse(call)


def is_slider(node) -> bool:
    return isinstance(node, ast.Call) and ast.unparse(node.func) == "panels.slider"


@pytest.mark.parametrize(
    ("text", "longest"),
    [
        (36 * "word " + ".", 36),
        (20 * "word " + ". " + 16 * "word ", 20),
        ("| " + 40 * "word " + "|", 0),
        ("<details>" + 40 * "word " + "</details> few", 1),
        ("- " + 30 * "word " + "\n- " + 10 * "word ", 30),
    ],
)
def test_a_long_sentence_is_found(text, longest):
    assert max(sentences(text), default=0) == longest


@pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)
def test_every_lesson_has_something_to_build(path):
    lines = {
        key: code_lines(re.sub(r"^\s*#.*\n", "", solution_text(key), flags=re.MULTILINE))
        for key in EXERCISES
        if key.startswith(path.stem[:2])
    }
    assert max(lines.values()) in BUILDING, lines
