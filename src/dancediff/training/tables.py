"""Tables of a TOML config: their keys must be known, and their values of the right kind.

Read first: docs/training.md · `dancediff.training.config`.
"""

import math
import tomllib
from dataclasses import fields
from pathlib import Path
from types import UnionType
from typing import Any, get_args, get_origin, get_type_hints

_WORDS = {int: "a whole number", float: "a number", str: "a text", bool: "true or false"}


def read_toml(path) -> dict:
    """A TOML file as it is.

    Raises: ValueError naming the file when it is missing or no TOML.
    """
    path = Path(path)
    try:
        # with a mark in front, as editors on Windows write it, or without
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError as err:
        raise ValueError(f"config {str(path)!r} does not exist; see configs/") from err
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as err:
        raise ValueError(f"config {str(path)!r} is no TOML file: {err}") from err
    except RecursionError as err:
        raise ValueError(f"config {str(path)!r} is nested too deeply") from err


def read_training(path) -> dict:
    """A TOML file with the tables that every training needs.

    Raises: ValueError naming the file when one is missing.
    """
    config = read_toml(path)
    for table in ("model", "train"):
        if table not in config:
            raise ValueError(f"config {str(path)!r} has no table [{table}]; see configs/")
    return config


def types_of(config_class) -> dict[str, type]:
    """What kind of value each plain field of a dataclass takes, by the field's name.

    >>> from dancediff.papers.tcdiffpp.losses import LossWeights
    >>> types_of(LossWeights)["dist"]
    <class 'float'>
    """
    hints, kinds = get_type_hints(config_class), {}
    for field in fields(config_class):
        kind = hints[field.name]
        if isinstance(kind, UnionType):  # a number or None, which TOML cannot say
            kind = next(part for part in get_args(kind) if part is not type(None))
        kind = get_origin(kind) or kind
        if kind in (*_WORDS, tuple, list):
            kinds[field.name] = kind
    return kinds


def check_all(config: dict, known: dict[str, type], source: str) -> dict[str, dict]:
    """Every known table of a config, empty where left out; ``known`` names their dataclasses.

    Raises: ValueError naming the source, the table, the key and the value that does not fit.
    """
    for table in config:
        if table not in known:
            words = ", ".join(known)
            raise ValueError(f"{source}: there is no table {table!r}; known: {words}")
    return {
        table: check_table(config.get(table, {}), kind, f"{source}: {table!r}")
        for table, kind in known.items()
    }


def check_table(values, kind: type, source: str) -> dict:
    """The table, with lists as tuples where the field is one; ``source`` begins the message.

    ``class``, which names a model, may stand in any table.

    Raises: ValueError naming the source, the key, its value and what it should be.

    >>> from dancediff.training.config import TrainConfig
    >>> check_table({"steps": 5, "lr": 1}, TrainConfig, "a.toml: 'train'")
    {'steps': 5, 'lr': 1}
    >>> check_table({"steps": "many"}, TrainConfig, "a.toml: 'train'")
    Traceback (most recent call last):
    ValueError: a.toml: 'train': steps='many' should be a whole number
    """
    if not isinstance(values, dict):
        raise ValueError(f"{source} is {values!r}, no table; write its keys below its [name]")
    kinds = types_of(kind) | {"class": str}
    for key in values:
        if key not in kinds:
            raise ValueError(f"{source} has no {key!r}; known: {', '.join(sorted(kinds))}")
    checked = {key: _checked(key, value, kinds[key], source) for key, value in values.items()}
    build(kind, {key: value for key, value in checked.items() if key != "class"}, source)
    return checked


def build(kind: type, values: dict, source: str):
    """The dataclass of a table; what it complains of is named with the source."""
    try:
        return kind(**values)
    except (TypeError, ValueError) as err:
        raise ValueError(f"{source}: {err}") from err


def _checked(key: str, value: Any, kind: type, source: str):
    if kind in (tuple, list):
        if not isinstance(value, list | tuple):
            raise ValueError(f"{source}: {key}={value!r} should be a list")
        return kind(value)
    # whole numbers are numbers, too, but true and false are none
    if type(value) is not kind and not (kind is float and type(value) is int):
        raise ValueError(f"{source}: {key}={value!r} should be {_WORDS.get(kind, kind.__name__)}")
    if isinstance(value, int | float) and not 0 <= value < math.inf:
        raise ValueError(f"{source}: {key}={value} must be 0 or more")
    return value
