"""Networks of the user's own: found by their names, and named in model folders.

Read first: `dancediff.own` · `dancediff.extensions.build`.
"""

from typing import cast

from torch import nn

from dancediff.extensions.build import paper_class
from dancediff.own import is_own, own_part
from dancediff.papers.edge.model import EDGE
from dancediff.papers.tcdiffpp.model import TCDiffPP


def own_network(name: str | type) -> type[nn.Module]:
    """A class of the user's own, by its name "module:Class" or as it is.

    Raises: ValueError when there is none, or it is derived from no network of ours.
    """
    found = own_part(name, "class") if isinstance(name, str) else name
    if not (isinstance(found, type) and issubclass(found, TCDiffPP | EDGE)):
        raise ValueError(f"class={name!r} must be derived from TCDiffPP or EDGE")
    return cast(type[nn.Module], found)


def class_name(kind: type[nn.Module]) -> str:
    """What a model folder calls a network: the paper's name, or "module:Class" of the user's own.

    >>> from dancediff.extensions.networks import ExtendedEDGE
    >>> class_name(ExtendedEDGE)
    'EDGE'
    """
    if kind.__module__.startswith("dancediff."):
        return paper_class(kind).__name__
    name = f"{kind.__module__}:{kind.__qualname__}"
    if not is_own(name) or "<locals>" in name:
        raise ValueError(f"class {name} is made inside a function; define it in a module")
    return name
