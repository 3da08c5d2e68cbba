"""Tables of a TOML config: their keys must be known, and their values of the right kind."""

from dataclasses import fields
from types import UnionType
from typing import get_args, get_origin, get_type_hints

_WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def kinds_of(config_class) -> dict[str, type]:
    """What kind of value each field of a dataclass takes, by the field's name.

    >>> from dancediff.papers.tcdiffpp.losses import LossWeights
    >>> kinds_of(LossWeights)["dist"]
    <class 'float'>
    """
    hints, kinds = get_type_hints(config_class), {}
    for field in fields(config_class):
        kind = hints[field.name]
        if isinstance(kind, UnionType):  # a number or None, which TOML cannot say
            kind = next(part for part in get_args(kind) if part is not type(None))
        kinds[field.name] = get_origin(kind) or kind
    return kinds


def check_all(config: dict, known: dict[str, dict[str, type]], source: str) -> dict[str, dict]:
    """Every known table of a config, empty where left out; see `check_table`.

    Raises: ValueError naming the source, the table and the key that is unknown or does not fit.
    """
    for table in config:
        if table not in known:
            known_ones = ", ".join(known)
            raise ValueError(f"{source}: there is no table {table!r}; known: {known_ones}")
    return {
        table: check_table(config.get(table, {}), kinds, f"{source}: {table!r}")
        for table, kinds in known.items()
    }


def check_table(values, kinds: dict[str, type], source: str) -> dict:
    """The table, with lists as tuples where the field is one; ``source`` begins the message.

    Raises: ValueError naming the source, the key, its value and what it should be.

    >>> check_table({"steps": 5, "lr": 1}, {"steps": int, "lr": float}, "a.toml: 'train'")
    {'steps': 5, 'lr': 1}
    >>> check_table({"steps": "many"}, {"steps": int}, "a.toml: 'train'")
    Traceback (most recent call last):
    ValueError: a.toml: 'train': steps='many' should be a whole number
    """
    if not isinstance(values, dict):
        raise ValueError(f"{source} is {values!r}, no table; write its keys below its [name]")
    for key in values:
        if key not in kinds:
            raise ValueError(f"{source} has no {key!r}; known: {', '.join(sorted(kinds))}")
    return {key: _checked(key, value, kinds[key], source) for key, value in values.items()}


def _checked(key: str, value, kind: type, source: str):
    if kind in (tuple, list):
        if not isinstance(value, list | tuple):
            raise ValueError(f"{source}: {key}={value!r} should be a list")
        return kind(value)
    # whole numbers are numbers, too, but true and false are none
    if type(value) is kind or (kind is float and type(value) is int):
        return value
    raise ValueError(f"{source}: {key}={value!r} should be {_WORDS.get(kind, kind.__name__)}")
