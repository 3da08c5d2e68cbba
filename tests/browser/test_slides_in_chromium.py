"""Slides turn by keys and clicks, and leave the browser its own."""

import sys

import nbformat
import pytest

from places import BOOKS

sys.path.insert(0, str(BOOKS))

import slides


@pytest.fixture
def deck(page, tmp_path):
    """Three slides; the first is longer than the window."""
    texts = ["# One\n\n" + "word and word\n\n" * 60, "# Two", "# Three"]
    book = nbformat.v4.new_notebook(cells=[nbformat.v4.new_markdown_cell(text) for text in texts])
    file = tmp_path / "deck.html"
    file.write_text(slides.page(book), encoding="utf-8")
    page.goto(file.as_uri())
    return page


def shown(page):
    return page.locator("section.now h1").inner_text()


def test_a_slide_is_seen_from_its_top(deck):
    deck.evaluate("scrollTo(0, 300)")
    deck.keyboard.press("ArrowRight")
    deck.keyboard.press("ArrowLeft")
    assert shown(deck) == "One" and deck.evaluate("scrollY") == 0


def test_keys_with_alt_control_and_meta_are_the_browser_s(deck):
    kept = deck.evaluate(
        "['altKey', 'ctrlKey', 'metaKey'].map((name) => dispatchEvent("
        "new KeyboardEvent('keydown', { key: 'ArrowRight', [name]: true, cancelable: true })))"
    )
    assert kept == [True] * 3 and shown(deck) == "One"
    deck.keyboard.press("ArrowRight")
    assert shown(deck) == "Two"


def test_who_selects_a_text_does_not_turn(deck):
    text = deck.locator("p").first.bounding_box()
    middle = text["y"] + text["height"] / 2
    deck.mouse.move(text["x"] + 2, middle)
    deck.mouse.down()
    deck.mouse.move(text["x"] + 100, middle, steps=5)
    deck.mouse.up()
    assert deck.evaluate("String(getSelection())").startswith("word")
    assert shown(deck) == "One"
    deck.mouse.click(text["x"] + 400, middle)  # lets go of the text
    assert shown(deck) == "Two"
