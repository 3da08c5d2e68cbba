"""The parser's complaints as one plain line."""

import re
from dataclasses import fields
from types import UnionType
from typing import Annotated, Union, get_args, get_origin

from dancediff.cli.commands import COMMANDS
from dancediff.cli.options import in_words


def explain(args: list[str], words: str) -> str:
    """One plain line out of the parser's drawn box: the option, the value and the fix.

    >>> explain(["generate", "song.ogg", "--seed", "1.5"], "| Error parsing --seed: invalid")
    "--seed '1.5': give a whole number; see `dancediff generate --help`"
    """
    command = args[0] if args else ""
    if command not in COMMANDS:
        what = f"{command!r} is no command; choose" if command else "choose a command:"
        return f"{what} {', '.join(COMMANDS)}; see `dancediff --help`"
    see = f"; see `dancediff {command} --help`"
    bare = [
        re.sub(r"\x1b\[[0-9;]*m|[\u2500-\u257f|]|-{9,}", "", line).strip()
        for line in words.splitlines()
    ]
    if bad := re.search(r"(?:parsing |argument ')(--[\w-]+)", " ".join(bare)):
        option = bad[1]
        types = {one.name: one.type for one in fields(COMMANDS[command])}
        kind = _kind(types.get(option[2:].replace("-", "_")))
        return f"{option} {_value_of(option, args)!r}: give {kind}{see}"
    parts: list[str] = []
    near = re.search(r"meant: (--[\w-]+)", " ".join(bare))
    for line in bare[1:]:  # the first line is the title of the box
        if not line or line.startswith(("For full helptext", "Perhaps you meant")):
            if parts:
                break
            continue
        parts.append(line)
    hint = f"; do you mean {near[1]}?" if near else ""
    return (" ".join(parts).rstrip(".") or f"cannot understand {' '.join(args)!r}") + hint + see


def _kind(annotation) -> str:
    """What an option wants, in words."""
    while get_origin(annotation) in (Annotated, Union, UnionType):
        annotation = get_args(annotation)[0]
    return in_words(annotation)


def _value_of(option: str, args: list[str]) -> str:
    for k, arg in enumerate(args):
        if arg.startswith(f"{option}="):
            return arg.removeprefix(f"{option}=")
        if arg == option:
            rest = args[k + 1 :]
            stop = next((i for i, word in enumerate(rest) if word.startswith("--")), len(rest))
            return " ".join(rest[:stop])
    return ""
