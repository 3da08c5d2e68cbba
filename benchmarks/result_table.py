"""Tables of docs/results, as files: the form that docs/site/tables.py reads."""

import json
from pathlib import Path


def printed(row: list) -> str:
    """A row as a terminal shows it.

    >>> printed(["depth", [1.5, 1.0, 2.0], 3, {"bold": "no"}])
    '| depth | 1.5 [1, 2] | 3 | **no** |'
    """
    return f"| {' | '.join(map(_cell, row))} |"


def _cell(value) -> str:
    if isinstance(value, dict):
        return f"**{_cell(value['bold'])}**"
    if isinstance(value, list):
        middle, low, high = map(_cell, value)
        return f"{middle} [{low}, {high}]"
    return value if isinstance(value, str) else f"{value:g}"


def write_table(path: Path, table: dict) -> None:
    """Write a table whole, with a line for each row."""
    head = json.dumps({k: v for k, v in table.items() if k != "rows"}, indent=1, ensure_ascii=False)
    rows = ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in table["rows"])
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix(".part")
    part.write_text(f'{head.rstrip("}").rstrip()},\n "rows": [\n{rows}\n ]\n}}\n', encoding="utf-8")
    part.replace(path)
