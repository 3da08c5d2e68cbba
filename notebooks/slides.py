"""The lessons as slides: `python notebooks/slides.py FOLDER [NN ...]`, one HTML file each.

A slide is a text with what it is about, or a cell that draws, with its picture. Arrow keys and
clicks turn pages. Everything is in the file: it needs no network. Answers to predictions stand in
stored outputs, so exercises are shown without what comes behind them on the same slide.
Formulas need the extra `docs`; without it they are shown as they are written.
"""

import argparse
import html
import re
import sys
from pathlib import Path

import mistune
import nbformat
from pygments import highlight
from pygments.formatters import HtmlFormatter
from pygments.lexers import PythonLexer

HERE = Path(__file__).parent
LESSONS = sorted(HERE.glob("[0-9]*.ipynb"))
CODE = HtmlFormatter(nobackground=True)
HIDDEN = {"setup", "check", "jump-in", "widget"}  # tags of cells that are no slide
BLOCK = re.compile(r"^\$\$(.+?)\$\$(?: *\\tag\{\d+\})?$", re.DOTALL | re.MULTILINE)  # a formula
HINT = re.compile(r"<details>.*?</details>", re.DOTALL)  # for who sits alone with an exercise
STYLE = """
body { margin: 0; font: 26px/1.4 system-ui, sans-serif; color: #222; background: #fff }
section { display: none; box-sizing: border-box; min-height: 100vh; padding: 4vh 8vw }
section.now { display: block }
img { max-width: 84vw; max-height: 60vh; min-width: 50vw; object-fit: contain }
pre { font-size: 18px; line-height: 1.3; overflow-x: auto }
table { border-collapse: collapse; font-size: 22px } td, th { padding: 4px 14px; text-align: left }
math[display=block] { margin: 24px 0 }
nav { position: fixed; right: 16px; bottom: 8px; font-size: 16px; color: #777 }
@media print { section { display: block; break-after: page } nav { display: none } }
"""
SCRIPT = """
const pages = document.querySelectorAll("section"), nav = document.querySelector("nav");
let now = 0;
function turn(by) {
  pages[now].classList.remove("now");
  now = Math.min(Math.max(now + by, 0), pages.length - 1);
  pages[now].classList.add("now");
  nav.textContent = `${now + 1} / ${pages.length}`;
  scrollTo(0, 0);
}
const ways = {ArrowRight: 1, PageDown: 1, " ": 1, ArrowLeft: -1, PageUp: -1, Home: -1e6, End: 1e6};
addEventListener("keydown", (e) => {
  if (!(e.key in ways) || e.altKey || e.ctrlKey || e.metaKey) return; // Alt ← is the browser's
  e.preventDefault();
  turn(ways[e.key]);
});
addEventListener("click", () => getSelection().isCollapsed && turn(1)); // who selects does not turn
turn(0);
"""


def formula(latex: str, display: str) -> str:
    """A formula as MathML, or as LaTeX where the extra `docs` is not installed."""
    sys.path.insert(0, str(HERE.parent / "docs" / "site"))
    try:
        from mathml import to_mathml
    except ImportError:
        return f"<code>{html.escape(latex)}</code>"
    return to_mathml(latex, display)


class Renderer(mistune.HTMLRenderer):
    """Markdown of a lesson: formulas as MathML, links as text, since slides have no neighbours."""

    def block_math(self, text: str) -> str:
        """``$$...$$``."""
        return f"<p>{formula(text, 'block')}</p>\n"

    def inline_math(self, text: str) -> str:
        """``$...$``."""
        return formula(text, "inline")

    def link(self, text: str, url: str, title: str | None = None) -> str:
        """The words of a link."""
        return text


def slides(book) -> list[str]:
    """The HTML of each slide."""
    markdown = mistune.create_markdown(
        renderer=Renderer(escape=False), plugins=["math", "table", "strikethrough"]
    )
    pages = []
    for cell in book.cells:
        if cell.cell_type == "markdown":
            source = HINT.sub("", BLOCK.sub(r"\n$$\n\1\n$$\n", cell.source))
            parts = source.replace("\n## ", "\n\f## ").replace("\n### ", "\n\f### ")
            pages += [str(markdown(part)) for part in parts.split("\f")]
        elif not HIDDEN & set(cell.metadata.get("tags", [])):
            code = highlight(cell.source, PythonLexer(), CODE)
            pages += [shown + code for shown in map(picture, cell.outputs) if shown] or [code]
    return pages


def picture(output) -> str:
    """What a cell stores, if it is a picture or a text."""
    data = output.get("data", {})
    if "image/png" in data:
        return f'<p><img alt="" src="data:image/png;base64,{data["image/png"].strip()}"></p>'
    return f"<pre>{html.escape(output['text'])}</pre>" if output.get("text") else ""


def page(book) -> str:
    """One file with all slides of a lesson."""
    title = html.escape(book.cells[0].source.splitlines()[0].lstrip("# "))
    body = "\n".join(f"<section>{one}</section>" for one in slides(book))
    style = STYLE + CODE.get_style_defs("pre")
    head = f'<meta charset="utf-8"><title>{title}</title><style>{style}</style>'
    return f"<!doctype html>\n{head}\n{body}\n<nav></nav><script>{SCRIPT}</script>\n"


def main(folder: Path, lessons: list[str]) -> None:
    """Write the slides of the named lessons, or of all."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in LESSONS:
        if not lessons or path.name[:2] in lessons:
            text = page(nbformat.read(path, 4))
            (folder / f"{path.stem}.html").write_text(text, encoding="utf-8")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("lessons", nargs="*", help="such as 05 09; all unless given")
    options = parser.parse_args()
    main(options.folder, options.lessons)
