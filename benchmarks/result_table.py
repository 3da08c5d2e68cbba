"""Tables of docs/results, as files: the form that docs/site/tables.py reads."""

import json
from pathlib import Path

from dancediff.atomic import write_text


def write_table(path: Path, table: dict) -> None:
    """Write a table whole, with a line for each row."""
    head = json.dumps({k: v for k, v in table.items() if k != "rows"}, indent=1, ensure_ascii=False)
    rows = ",\n".join(f"  {json.dumps(row, ensure_ascii=False)}" for row in table["rows"])
    write_text(path, f'{head.rstrip("}").rstrip()},\n "rows": [\n{rows}\n ]\n}}\n')
