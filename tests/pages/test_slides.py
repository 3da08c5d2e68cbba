"""Slides are whole: every text and picture of a lesson, one file, no host outside."""

import re
import sys

import nbformat
import pytest

from places import BOOKS

sys.path.insert(0, str(BOOKS))

import slides

LESSONS = sorted(BOOKS.glob("[0-9]*.ipynb"))


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_slides_load_nothing_from_elsewhere(path):
    page = slides.page(nbformat.read(path, 4))
    loads = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?([^"'\s>)]{1,40})""", page)
    assert [one for one in loads if not one.startswith("data:")] == []
    hosts = set(re.findall(r"https?://([\w.]+)", page))
    assert hosts <= {"www.w3.org"}, "a name of MathML is the only address"


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_all_pictures_and_sections_are_there(path):
    book = nbformat.read(path, 4)
    page = slides.page(book)
    told = [cell for cell in book.cells if not slides.HIDDEN & set(cell.metadata.get("tags", []))]
    pictures = [
        output.data["image/png"]
        for cell in told
        if cell.cell_type == "code"
        for output in cell.outputs
        if "image/png" in output.get("data", {})
    ]
    assert page.count("<img") == len(pictures) > 0
    headings = sum(len(re.findall(r"^#{1,3} ", c.source, re.MULTILINE)) for c in told)
    code = sum(c.source.count("\n# ") + c.source.startswith("# ") for c in told if "outputs" in c)
    assert len(re.findall(r"<h[123]>", page)) == headings - code
    assert page.count("<section>") > headings - code


def test_formulas_are_formulas(monkeypatch):
    monkeypatch.setattr(slides, "formula", lambda latex, display: f"<{display}>{latex.strip()}")
    book = nbformat.v4.new_notebook()
    book.cells = [nbformat.v4.new_markdown_cell("# A\n\nso $a_1$:\n\n$$x_i * y_i * z$$\n\nend")]
    (one,) = slides.slides(book)
    assert "<inline>a_1" in one and "<block>x_i * y_i * z" in one and "$" not in one


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_every_formula_of_a_lesson_is_found(path, monkeypatch):
    """No dollar sign is left in what is read."""
    monkeypatch.setattr(slides, "formula", lambda latex, display: "F")
    texts = [c for c in nbformat.read(path, 4).cells if c.cell_type == "markdown"]
    book = nbformat.v4.new_notebook()
    book.cells = texts
    assert [one for one in slides.slides(book) if "$" in re.sub(r"<code>.*?</code>", "", one)] == []


def test_a_text_that_begins_a_section_begins_a_slide():
    book = nbformat.v4.new_notebook()
    book.cells = [nbformat.v4.new_markdown_cell("# A\n\nfirst\n\n## B\n\nsecond [x](x.ipynb)")]
    first, second = slides.slides(book)
    assert "first" in first and "second x" in second and "href" not in second


def test_stored_answers_of_checks_are_no_slides():
    book = nbformat.v4.new_notebook()
    check = nbformat.v4.new_code_cell('nb.check("01.1", x)', metadata={"tags": ["check"]})
    book.cells = [nbformat.v4.new_markdown_cell("# A"), check]
    assert "nb.check" not in slides.page(book)
