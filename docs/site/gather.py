"""Gather the pages of the site in one folder: documents, lessons, API.

    python docs/site/gather.py out/docs-source

The documents stay where they are and links between them stay as they are: what is gathered keeps
its place relative to the rest. Only the README becomes the front page, with the table of contents
of docs/index.md, and the API pages are written from docstrings.
"""

import json
import re
import sys
from pathlib import Path

from api_pages import api_pages, full_names, public_modules

ROOT = Path(__file__).parents[2]
DOCUMENTS = (
    "THIRD_PARTY.md",
    "CHANGELOG.md",
    "docs/*.md",
    "docs/results/*.md",
    "data_prep/README.md",
    "src/dancediff/assets/models/*/card.md",
)
DETAILS = re.compile(r"(<details>\s*<summary>.*?</summary>)(.*?)(</details>)", re.DOTALL)
PICTURED = re.compile(r'<a href="(\w+)\.ipynb"')  # a lesson, in what a cell shows
LINK = re.compile(r"(?<!!)\[([^\[\]]+)\]\(([^)\s#:]+)((?:#[^)\s]*)?)\)")


def gather(folder: Path) -> set[str]:
    """Write all pages, touching none that has not changed; returns their names."""
    modules = public_modules(ROOT / "src" / "dancediff")
    names = full_names(modules)
    pages: dict[str, bytes] = {}
    for path in (ROOT / "docs" / "images").iterdir():
        pages[_name(path)] = path.read_bytes()
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        pages[_name(path)] = lesson(path.read_text(encoding="utf-8")).encode()
    front = (ROOT / "README.md").read_text(encoding="utf-8")
    contents = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    texts = {"index.md": front + "\n" + contents[contents.index("```{toctree}") :]}
    for pattern in DOCUMENTS:
        for path in sorted(ROOT.glob(pattern)):
            texts[_name(path)] = path.read_text(encoding="utf-8")
    del texts["docs/index.md"]
    for page, text in texts.items():
        source = ROOT / ("README.md" if page == "index.md" else page)
        written, linked = for_site(text, source, names, known={*texts, *pages})
        pages[page] = written.encode()
        pages |= {_name(path): path.read_bytes() for path in linked}
    lessons = {Path(page).name[:2]: page for page in pages if page.endswith(".ipynb")}
    for page, text in api_pages(modules, order_of_packages(), lessons).items():
        pages[f"{page}.md"] = text.encode()
    for name, content in pages.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        if not path.exists() or path.read_bytes() != content:
            path.write_bytes(content)
    for path in folder.rglob("*"):
        if path.is_file() and path.relative_to(folder).as_posix() not in pages:
            path.unlink()
    return set(pages)


def lesson(text: str) -> str:
    """A notebook whose hints are Markdown, too: what touches an HTML tag is taken as HTML.

    Links in pictures lead to pages instead of notebooks: Sphinx does not look into outputs.
    """
    notebook = json.loads(text)
    for cell in notebook["cells"]:
        if cell["cell_type"] == "markdown":
            cell["source"] = DETAILS.sub(r"\1\n\n\2\n\n\3", "".join(cell["source"]))
        for data in (output.get("data", {}) for output in cell.get("outputs", [])):
            if "text/html" in data:
                html = "".join(data["text/html"])
                data["text/html"] = PICTURED.sub(r'<a href="\1.html"', html)
    return json.dumps(notebook)


def for_site(text: str, source: Path, names: set[str], known: set[str]) -> tuple[str, list[Path]]:
    """A document for the site, and files to be put beside it because it links to them.

    Source files become their page of the API, folders and the training log lose their link, and
    full names in backticks gain one.
    """
    linked: list[Path] = []

    def link(match: re.Match) -> str:
        words, target, anchor = match.groups()
        path = (source.parent / target).resolve()
        if path == ROOT / "README.md":
            return f"[{words}]({_up(source)}index.md{anchor})"
        if path.suffix == ".py" and path.is_relative_to(ROOT / "src"):
            module = ".".join(path.relative_to(ROOT / "src").with_suffix("").parts)
            return f"[{words}]({_up(source)}api/{module.removesuffix('.__init__')}.md)"
        if path.is_dir() or path.is_relative_to(ROOT / "docs" / "log"):  # not part of the site
            return words
        if path.is_file() and _name(path) not in known:
            linked.append(path)
        return match[0]

    def symbol(match: re.Match) -> str:
        return f"{{py:obj}}`{match[1]}`" if match[1] in names else match[0]

    parts = re.split(r"(^```.*?^```$)", text, flags=re.DOTALL | re.MULTILINE)
    parts[::2] = [
        re.sub(r"(?<![`\[])`(dancediff\.[\w.]+)`", symbol, LINK.sub(link, part))
        for part in parts[::2]
    ]
    return "".join(parts), linked


def order_of_packages() -> list[str]:
    """As the map in docs/architecture.md has them."""
    text = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    return re.search(r"<!-- map: ([\w\s]+) -->", text)[1].split()


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _up(source: Path) -> str:
    return "../" * len(source.parent.relative_to(ROOT).parts)


if __name__ == "__main__":
    gather(Path(sys.argv[1]))
