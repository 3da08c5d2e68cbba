"""Write the tables of the pages: numbers from docs/results/*.json, the map from the source.

    python docs/site/tables.py           # after a measurement: write all pages anew
    python docs/site/tables.py --check   # status 1 if a page is not what the numbers say

A page asks for a table with two lines, ``<!-- table: NAME -->`` and ``<!-- end -->``; what stands
between them is written here, from ``docs/results/NAME.json``:

    about      what was measured, one sentence
    data       "synthetic", "real", "composed", or which of them in which column
    command    what was typed to make it, a list if it took several; or a sentence that says what
               made it, or why nothing does
    seed, intervals, date   what else is known, as text; absent if it is not
    columns    headings
    rows       cells: text, a number, null for "does not apply", [value, low, high] for a value with
               its interval, {"bold": cell}

Numbers keep the digits of the file, so 0.90 stays 0.90.

``<!-- map: PART PART ... -->`` asks for a line for each package and module of the first level, in
this order: what its docstring says it is, and the modules in it. What `dance_page.py` makes is
written, too.
"""

import ast
import json
import re
import sys
import textwrap
from decimal import Decimal
from pathlib import Path

import dance_page

from dancediff.atomic import write_text

DOCS = Path(__file__).parents[1]
RESULTS = DOCS / "results"
PAGES = sorted([*DOCS.glob("*.md"), *RESULTS.glob("*.md")])
LOG = sorted(DOCS.glob("log/*.md"))  # has tables, too, but is no page that is read
SOURCE = DOCS.parent / "src" / "dancediff"
BLOCK = re.compile(r"(<!-- table: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
MAP = re.compile(r"(<!-- map: ([\w\s]+) -->\n).*?(<!-- end -->)", re.DOTALL)
WHOLE_WORDS = {"break_long_words": False, "break_on_hyphens": False}
REQUIRED = {"about", "data", "command", "columns", "rows"}
ALLOWED = REQUIRED | {"seed", "intervals", "date"}
PROGRAMS = ("dancediff ", "make ", "python ")


def load(name: str) -> dict:
    """One file of numbers; ValueError if it has an unknown key, lacks one or has a ragged row."""
    table = json.loads((RESULTS / f"{name}.json").read_text(encoding="utf-8"), parse_float=Decimal)
    if not REQUIRED <= set(table) <= ALLOWED:
        raise ValueError(f"{name}.json: keys {sorted(set(table))}, required {sorted(REQUIRED)}")
    if any(len(row) != len(table["columns"]) for row in table["rows"]):
        raise ValueError(f"{name}.json: rows must have {len(table['columns'])} cells, as columns")
    return table


def cell(value) -> str:
    """A cell as text.

    >>> cell(None), cell(Decimal("0.90")), cell(12383), cell({"bold": "no"})
    ('-', '0.90', '12,383', '**no**')
    >>> cell([Decimal("1.5"), 1, 2]), cell(0.25)
    ('1.5 [1, 2]', '0.25')
    """
    if value is None:
        return "-"
    if isinstance(value, dict):
        return f"**{cell(value['bold'])}**"
    if isinstance(value, float):
        value = Decimal(repr(value))
    if isinstance(value, list):
        middle, low, high = (cell(number) for number in value)
        return f"{middle} [{low}, {high}]"
    return value if isinstance(value, str) else f"{value:,f}" if value % 1 else f"{value:,}"


def markdown(table: dict) -> str:
    """The table and, below it, one line that says where it comes from."""
    rows = [table["columns"], ["---"] * len(table["columns"]), *table["rows"]]
    lines = [f"| {' | '.join(cell(value) for value in row)} |" for row in rows]
    facts = [f"Data: {table['data']}", *([f"seed: {table['seed']}"] if "seed" in table else [])]
    facts += [f"brackets: {table['intervals']}"] if "intervals" in table else []
    facts += [table["date"]] if "date" in table else []
    source, block = made_by(table["command"])
    below = textwrap.wrap(f"{table['about']} {'; '.join(facts)}. {source}", 100, **WHOLE_WORDS)
    return "\n".join([*lines, "", *below, *block, ""])


def made_by(command: str | list[str]) -> tuple[str, list[str]]:
    """The end of the line below a table, and lines to copy if several commands were typed.

    >>> made_by("make x"), made_by("By hand.")
    (('Made by `make x`.', []), ('By hand.', []))
    >>> made_by(["make x", "make y"])
    ('Made by:', ['', '```sh', 'make x', 'make y', '```'])
    """
    if isinstance(command, str):
        return f"Made by `{command}`." if command.startswith(PROGRAMS) else command, []
    rows = (textwrap.wrap(one, 98, subsequent_indent="    ", **WHOLE_WORDS) for one in command)
    return "Made by:", ["", "```sh", *(" \\\n".join(row) for row in rows), "```"]


def map_of_source(parts: list[str]) -> str:
    """A line for each part, those that ``parts`` does not name at the end."""
    there = {p.stem for p in SOURCE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    there -= {"__init__"}
    lines = ["| part | what it is | modules |", "| --- | --- | --- |"]
    for part in [*(p for p in parts if p in there), *sorted(there - set(parts))]:
        folder, file = SOURCE / part, SOURCE / f"{part}.py"
        text = (file if file.exists() else folder / "__init__.py").read_text(encoding="utf-8")
        doc = ast.get_docstring(ast.parse(text))
        first = re.sub(r"``", "`", doc.split("\n\n")[0].replace("\n", " ")).replace("|", r"\|")
        inside = {p.relative_to(folder).with_suffix("").as_posix() for p in folder.rglob("*.py")}
        names = sorted(
            name for name in inside if not name.endswith("__init__") and "__" not in name
        )
        lines.append(f"| `{part}` | {first} | {' · '.join(names)} |")
    return "\n".join([*lines, ""])


def written(text: str) -> str:
    """A page with the tables that it asks for."""
    text = dance_page.written(text)
    text = MAP.sub(lambda m: f"{m[1]}\n{map_of_source(m[2].split())}\n{m[3]}", text)
    return BLOCK.sub(lambda m: f"{m[1]}\n{markdown(load(m[2]))}\n{m[3]}", text)


def asked_for() -> set[str]:
    """Names of all tables that some page asks for."""
    pages = (path.read_text(encoding="utf-8") for path in [*PAGES, *LOG])
    return {match[2] for page in pages for match in BLOCK.finditer(page)}


def main(check: bool) -> int:
    """Write the pages, or only look; returns the exit status."""
    stale, pages = [], {path: written(path.read_text(encoding="utf-8")) for path in [*PAGES, *LOG]}
    for path, now in (pages | {dance_page.PICTURE: dance_page.picture()}).items():
        if not path.exists() or path.read_text(encoding="utf-8") != now:
            stale.append(path.name)
            if not check:
                write_text(path, now)
    print(f"{'not up to date' if check else 'written'}: {', '.join(stale) or 'none'}")
    return int(check and bool(stale))


if __name__ == "__main__":
    sys.exit(main("--check" in sys.argv[1:]))
