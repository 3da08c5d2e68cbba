"""Our docstrings, said in Markdown: fields, formulas, symbol tables and examples."""

import re
import textwrap
from collections.abc import Callable, Iterator

FIELDS = "Read first|Shapes|Raises|Source|Differs|Learned"
COLUMNS = ("symbol", "meaning", "shape, unit", "")
CODE_OR_MATHS = re.compile(r"(``.+?``|`[^`]+`|\$[^$]+\$)", re.DOTALL)
ALIGNED = re.compile(rf"^(?!(?:{FIELDS}):)\S.*?[^\s.:;,] {{2,}}\S", re.MULTILINE)

Link = Callable[[str], str | None]  # a name as it is written -> its full name, if it is ours


def markdown(doc: str, link: Link) -> str:
    """A whole docstring; paragraphs are told apart by how they begin."""
    examples_apart = re.sub(r"(?m)^(?!>>>|\.\.\. )(.*\S.*)\n>>>", r"\1\n>>>", doc)
    return "\n\n".join(_block(block, link) for block in _blocks(examples_apart))


def first_line(doc: str, link: Link) -> str:
    """What it is, in one line."""
    return inline(doc.partition("\n\n")[0].replace("\n", " "), link)


def inline(text: str, link: Link) -> str:
    """Names of ours become links; `<` is no HTML, `_` no emphasis."""
    parts = CODE_OR_MATHS.split(text)
    parts[::2] = [re.sub(r"[<_]", r"\\\g<0>", part) for part in parts[::2]]
    parts[1::2] = [_code(part, link) for part in parts[1::2]]
    return "".join(parts)


def _code(part: str, link: Link) -> str:
    name = part.strip("`").replace("\n", " ")
    full = link(name) if re.fullmatch(r"`[\w.]+`", part) else None
    return part if full is None else f"{{py:obj}}`{name} <{full}>`"


def _blocks(doc: str) -> list[str]:
    """Paragraphs; what is indented belongs together across empty lines."""
    blocks: list[str] = []
    for block in _paragraphs(doc):
        if blocks and block.startswith("    ") and blocks[-1].startswith("    "):
            blocks[-1] += f"\n\n{block}"
        else:
            blocks.append(block)
    return blocks


def _paragraphs(doc: str) -> Iterator[str]:
    """What empty lines part; text and an indented listing right under it are two."""
    for paragraph in re.split(r"\n\s*\n", doc):
        head, listing, rest = paragraph.partition("\n    ")
        if listing and "$$" not in paragraph and not head.startswith(("Symbols", ">>>", "    ")):
            yield from (head, f"    {rest}")
        else:
            yield paragraph


def _block(block: str, link: Link) -> str:
    if block.startswith(">>>"):
        return _fence("pycon", block)
    if block.startswith(("    ", "====")):
        return _fence("text", textwrap.dedent(block))
    if block.startswith("Symbols"):
        return _symbols(block, link)
    if len(ALIGNED.findall(block)) * 2 > block.count("\n") + 1:
        return _fence("text", block)
    pieces = re.split(r"\$\$(.+?)\$\$", block, flags=re.DOTALL)
    pieces[::2] = [_fields(inline(piece.strip("\n"), link)) for piece in pieces[::2]]
    pieces[1::2] = [f"$$\n{textwrap.dedent(piece.strip())}\n$$" for piece in pieces[1::2]]
    return "\n\n".join(piece for piece in pieces if piece.strip())


def _fence(language: str, text: str) -> str:
    return f"```{language}\n{text}\n```"


def _fields(text: str) -> str:
    """`Shapes: ...` and its like, each with what follows it, as a list of fields."""
    head, *rest = re.split(rf"(?:^|\n|  +)({FIELDS}):\s", text)
    fields = [
        f":{name}: " + value.strip().replace("\n", "\n    ")
        for name, value in zip(rest[::2], rest[1::2], strict=True)
    ]
    return "\n\n".join(part for part in (head.strip("\n"), "\n".join(fields)) if part)


def _symbols(block: str, link: Link) -> str:
    """The symbols of a module as a table; a line that begins further right goes on."""
    head, body = re.fullmatch(r"Symbols(?: \((.*?)\))?((?:\n    .*)*)", block, re.DOTALL).groups()
    rows: list[list[str]] = []
    starts: list[int] = []
    for line in body.strip("\n").splitlines():
        cells = [(cell.start(), cell[0]) for cell in re.finditer(r"\S+(?: \S+)*", line)]
        if cells[0][0] == 4:
            rows.append([text for _, text in cells])
            starts = max(starts, [start for start, _ in cells], key=len)
            continue
        for start, text in cells:
            column = min(range(len(starts)), key=lambda k: abs(starts[k] - start))
            rows[-1] += [""] * (column + 1 - len(rows[-1]))
            rows[-1][column] = f"{rows[-1][column]} {text}".strip()
    width = max((len(row) for row in rows), default=0)
    lines = [COLUMNS[:width], ["---"] * width] if rows else []
    for row in rows:
        about = [inline(cell, link) for cell in row[1:]]
        lines.append([f"`{row[0]}`", *about, *[""] * (width - len(row))])
    table = "\n".join(
        "| " + " | ".join(cell.replace("|", r"\|") for cell in line) + " |" for line in lines
    )
    axes = "" if head is None else ":Axes: " + " ".join(head.removeprefix("axes: ").split())
    return "\n\n".join(part for part in (inline(axes, link), table) if part)
