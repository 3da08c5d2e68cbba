"""Options: fields of a request that say what they do and which values they may have."""

import math
import operator
from collections.abc import Callable, Iterable
from dataclasses import Field, field
from types import UnionType
from typing import Any, get_args

import numpy as np

from dancediff.own import is_own, own_function


def option(
    default,
    help: str,
    *,
    choices: tuple = (),
    low=0,
    high=math.inf,
    parse: Callable[[Any], Any] | None = None,
    own: bool = False,
) -> Any:
    """A field of a request with its help and the values that it may have.

    ``parse``: checks a value, and returns it in its one form.  ``own``: beside the choices, it may
    name a function of the user's own.
    """
    limits = {"help": help, "choices": tuple(choices), "low": low, "high": high, "parse": parse}
    limits["own"] = own
    return field(default=default, metadata=limits)


def kinds_of(one: Field) -> tuple:
    """The types that an option may have."""
    return get_args(one.type) if isinstance(one.type, UnionType) else (one.type,)


def checked(one: Field, value):
    """A value of an option as its type, if it is among those allowed.

    Raises: ValueError naming the option, its value and what is allowed.
    """
    if parse := one.metadata["parse"]:
        return parse(value)
    if one.metadata["own"] and is_own(value):
        own_function(value, one.name)
        return value
    if choices := one.metadata["choices"]:
        if value not in choices:
            allowed = ", ".join(map(repr, choices))
            raise ValueError(f"{one.name}={value!r} is not one of {allowed}")
        return value
    kinds = kinds_of(one)
    if bool in kinds:
        if not isinstance(value, bool | np.bool_):
            raise ValueError(f"{one.name}={value!r} must be True or False")
        return bool(value)
    for kind, number, words in ((int, operator.index, "an integer"), (float, float, "a number")):
        if kind in kinds:
            try:
                value = number(value)
            except (TypeError, ValueError):
                raise ValueError(f"{one.name}={value!r} must be {words}") from None
            check_range(one.name, value, one.metadata["low"], one.metadata["high"])
    return value


def one_or_several(value) -> tuple:
    """A value as a sequence of its own, unless it is one.

    >>> one_or_several("path"), one_or_several(["path", "end"])
    (('path',), ('path', 'end'))
    """
    one = isinstance(value, str) or not isinstance(value, Iterable)
    return (value,) if one else tuple(value)


def check_range(name: str, value: float, low: float, high: float) -> None:
    """Raises: ValueError unless low <= value <= high."""
    if not (low <= value <= high and math.isfinite(value)):
        limit = f"lie in {_short(low)} ... {_short(high)}"
        if high == math.inf:
            limit = f"be a number of at least {_short(low)}"
        raise ValueError(f"{name}={_short(value)} must {limit}")


def _short(value: float) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
