"""The options of `dancediff generate` and the columns of a manifest: those of all requests.

Read first: `dancediff.generation.request` · `dancediff.generation.option`.
"""

from dataclasses import Field, field, fields
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

import tyro

from dancediff.generation.dance_request import DTYPES
from dancediff.generation.option import kinds_of
from dancediff.generation.presets import PRESETS
from dancediff.generation.request import REQUESTS, default_of
from dancediff.own import is_own

LEFT_OUT = ""  # what an option is that was not given, where None is a value
NOT_HERE = ("start", "end", "constraints", "seed_motion")  # more than a word can say
WORDS = {bool: "True|False", int: "INT", float: "FLOAT", str: "STR", tuple[int, ...]: "INT INT ..."}
OTHER_TYPES: dict[str, Any] = {
    "swap": tuple[int, ...],
    "dtype": Literal[DTYPES],
    "device": str,
    "energy": str,
}
KINDS: dict[object, str] = {
    bool: "True or False",
    int: "a whole number",
    float: "a number",
    tuple[int, ...]: "whole numbers, such as 1 0 2",
}


def kind_of(one: Field) -> Any:
    """The type of an option where it is given as text."""
    if choices := one.metadata["choices"]:
        return Literal[choices]
    known = OTHER_TYPES.get(one.name)
    return known or next(kind for kind in (bool, int, float, str) if kind in kinds_of(one))


def takes_none(one: Field) -> bool:
    """Whether None is a value beside its default, so that "None" must be told from nothing given.

    >>> takes_none(FIELDS["at_once"]), takes_none(FIELDS["swap"])
    (True, False)
    """
    return NoneType in kinds_of(one) and one.default is not None


def given(command) -> dict[str, Any]:
    """The options of requests that were given in a command."""
    values = {name: getattr(command, name) for name in FIELDS}
    return {
        name: value
        for name, value in values.items()
        if value != (LEFT_OUT if takes_none(FIELDS[name]) else None)
    }


def command_option(one: Field) -> tuple[str, Any, Any]:
    """A field of the command: None, or `LEFT_OUT`, unless it is given: the preset can decide."""
    kind = kind_of(one)
    of = WORDS.get(kind) or "|".join(map(str, get_args(kind)))
    if one.metadata["own"]:  # the request checks it
        kind, of = str, f"{of}|MODULE:FUNCTION"
    default = None
    if takes_none(one):
        kind, of, default = kind | Literal[LEFT_OUT], f"{of}|None", LEFT_OUT
    shown = tyro.conf.arg(
        help=one.metadata["help"], metavar=of, help_behavior_hint=_defaults(one.name)
    )
    return one.name, Annotated[kind | None, shown], field(default=default)


def in_words(kind) -> str:
    """What values of a type look like.

    >>> in_words(int), in_words(Literal["a", "b"])
    ('a whole number', 'one of a, b')
    """
    if get_origin(kind) is Literal:
        return f"one of {', '.join(get_args(kind))}"
    return KINDS.get(kind, "another value")


def read_option(name: str, text: str):
    """The value of an option that stands in a cell of a table.

    Raises: ValueError saying what it must be.

    >>> read_option("swap", "1 0 2"), read_option("seconds", "7.5"), read_option("genre", "salsa")
    ((1, 0, 2), 7.5, 'salsa')
    >>> read_option("dancers", "three")
    Traceback (most recent call last):
    ValueError: dancers 'three': give a whole number
    """
    kind = kind_of(FIELDS[name])
    if FIELDS[name].metadata["own"] and is_own(text):
        return text
    if text == "None" and takes_none(FIELDS[name]):
        return None
    try:
        if kind is bool:
            return {"true": True, "false": False}[text.lower()]
        if get_origin(kind) is Literal:
            return get_args(kind)[get_args(kind).index(text)]
        if get_origin(kind) is tuple:
            return tuple(map(int, text.replace(",", " ").split()))
        return kind(text)
    except (ValueError, KeyError):
        raise ValueError(f"{name} {text!r}: give {in_words(kind)}") from None


def _defaults(name: str) -> str:
    """Which models have an option, and its defaults.

    >>> _defaults("top_k")
    '(bailando, codancers; default: 32; paper: 1)'
    >>> _defaults("soft")
    '(lodge; default: 0.75; paper: 1.0)'
    """
    families = [family for family, request in REQUESTS.items() if name in request.names()]
    words = [", ".join(families)] if len(families) < len(REQUESTS) else []
    for preset in PRESETS:
        values = {family: default_of(family, name, preset) for family in families}
        shown = dict.fromkeys(str(value) for value in values.values())
        text = ", ".join(f"{family} {v}" for family, v in values.items() if v is not None)
        text = next(iter(shown)) if len(shown) == 1 else text
        if text != "None" and not (words and words[-1].endswith(f": {text}")):
            words.append(f"{'default' if preset == 'packaged' else preset}: {text}")
    return f"({'; '.join(words)})" if words else ""


FIELDS = {
    one.name: one
    for request in REQUESTS.values()
    for one in fields(request)
    if one.name not in NOT_HERE
}
