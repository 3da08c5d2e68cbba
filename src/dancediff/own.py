"""Code of the user's own, named "module:name": a network, a loss, a sampler, a metric.

Such a name is an import, and an import runs code. So it is only ever taken from what the user
gives: a config, an option, an argument. A model folder may name a class, but that one is imported
only when the user names it, too (`dancediff.hub.load`).
"""

import importlib
import inspect
import re
import sys
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

_NAME = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*")


def is_own(name) -> bool:
    """Is this the name of code outside of dancediff?

    >>> is_own("mine:MeanFusion"), is_own("TCDiffPP")
    (True, False)
    """
    return isinstance(name, str) and ":" in name


def own_part(name: str, what: str):
    """Import "module:name"; the folder in which the program runs is looked in last.

    ``what`` begins the message of an error, such as "class".

    Raises: ValueError naming what is wrong: the form, the module, or the name in it.

    >>> own_part("math:hypot", "metric")(3, 4)
    5.0
    >>> own_part("math:hypott", "metric")
    Traceback (most recent call last):
    ValueError: metric='math:hypott': module 'math' has no 'hypott'
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise ValueError(f"{what}={name!r} must have the form 'module:name'")
    module, _, attribute = name.partition(":")
    here = str(Path.cwd())
    if here not in sys.path and "" not in sys.path:
        sys.path.append(here)  # last, so that no file there hides a library
    try:
        found = importlib.import_module(module)
    except Exception as err:  # the user's module may fail in any way
        raise ValueError(
            f"{what}={name!r}: module {module!r} cannot be imported "
            f"({type(err).__name__}: {err}); run in the folder that holds it, or install it"
        ) from err
    if not hasattr(found, attribute):
        raise ValueError(f"{what}={name!r}: module {module!r} has no {attribute!r}")
    return getattr(found, attribute)


def own_function(name: str, what: str):
    """The same for something that is called.

    Raises: ValueError as `own_part`, or when it cannot be called.
    """
    found = own_part(name, what)
    if not callable(found):
        raise ValueError(f"{what}={name!r} is a {type(found).__name__}, no function")
    return found


def own_digests(names: Iterable) -> dict[str, str]:
    """A hash of the source of each that names code of the user's own; others are left out.

    What was made with such code is not taken for what the code makes after a change of its file.
    Files that it imports do not count.

    Raises: ValueError as `own_part`.

    >>> list(own_digests(["TCDiffPP", None, "pathlib:Path"]))
    ['pathlib:Path']
    """
    return {name: sha256(_source(name).encode()).hexdigest() for name in names if is_own(name)}


def _source(name: str) -> str:
    """The file that is named, and the one that defines what it has of it; "" of compiled code."""
    found = own_part(name, "name")
    texts = []
    for module in dict.fromkeys((sys.modules[name.partition(":")[0]], inspect.getmodule(found))):
        try:
            texts.append("" if module is None else inspect.getsource(module))
        except (OSError, TypeError):
            continue
    return "".join(texts)
