"""Build a model with extensions by their names.

Without extensions it is the paper's model. ``model.extensions`` says which it has; model folders
and training configs store the same list.

Read first: `dancediff.extensions.registry` · `dancediff.extensions.networks`.
"""

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

from torch import nn

from dancediff.extensions.last_frame_residual import ExtendedFACT, ExtendedMNET
from dancediff.extensions.lodge_stages import extended_lodge
from dancediff.extensions.networks import (
    Extended,
    ExtendedEDGE,
    ExtendedGCD,
    ExtendedTCDiff,
    ExtendedTCDiffPP,
)
from dancediff.extensions.registry import REGISTRY
from dancediff.genre import GENRES
from dancediff.papers.bailando.model import Bailando, BailandoConfig
from dancediff.papers.codancers.model import CoDancers, CoDancersConfig
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.fact.model import FACT, FACTConfig
from dancediff.papers.gcd.model import GCD, GCDConfig
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.mnet.model import MNET, MNETConfig
from dancediff.papers.tcdiff.model import TCDiff, TCDiffConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

Model = TypeVar("Model", bound=nn.Module)
# with the class of their sizes, by the names that model folders and training configs have
NETWORKS: dict[str, tuple[Any, type]] = {
    "TCDiffPP": (TCDiffPP, TCDiffPPConfig),
    "EDGE": (EDGE, EDGEConfig),
    "GCD": (GCD, GCDConfig),
    "TCDiff": (TCDiff, TCDiffConfig),
    "Lodge": (Lodge, LodgeConfig),
    "FACT": (FACT, FACTConfig),
    "Bailando": (Bailando, BailandoConfig),
    "MNET": (MNET, MNETConfig),
    "CoDancers": (CoDancers, CoDancersConfig),
}
EXTENDED: dict[type[nn.Module], Callable[..., Any]] = {
    EDGE: ExtendedEDGE,
    GCD: ExtendedGCD,
    TCDiff: ExtendedTCDiff,
    TCDiffPP: ExtendedTCDiffPP,
    Lodge: extended_lodge,
    FACT: ExtendedFACT,
    MNET: ExtendedMNET,
}
FAMILIES: dict[type[nn.Module], str] = {
    EDGE: "edge",
    GCD: "gcd",
    TCDiff: "tcdiff",
    TCDiffPP: "tcdiffpp",
    Lodge: "lodge",
    FACT: "fact",
    Bailando: "bailando",
    MNET: "mnet",
    CoDancers: "codancers",
}
EXTENSIONS = {  # names by class
    model_class: tuple(e.name for e in REGISTRY.values() if e.kind == "network" and f in e.models)
    for model_class, f in FAMILIES.items()
}


def build(
    model_class: type[Model], config, extensions: Sequence[str] = (), genres: Sequence[str] = GENRES
) -> Model:
    """A model of random weights with the named extensions.

    ``genres``: names for the extension "genre_condition", which stay with the model; Lodge's are
    in its config.

    Raises: ValueError for an extension that the class does not have, or one without what it needs.

    >>> from dancediff.papers.edge.model import EDGEConfig
    >>> model = build(EDGE, EDGEConfig(d_model=16, num_layers=1), ["beat_phase"])
    >>> type(model).__name__, model.extensions
    ('ExtendedEDGE', ('beat_phase',))
    """
    check_extensions(model_class, config, extensions)
    named = {"genres": tuple(genres)} if "genre_condition" in extensions else {}
    make: Callable[..., Any] = EXTENDED.get(model_class, model_class)
    extended = bool(extensions) or issubclass(model_class, Extended)
    model = make(config, extensions, **named) if extended else model_class(config)
    model.extensions = tuple(extensions)  # type: ignore[assignment] # torch expects modules only
    return model


def check_extensions(model_class: type[nn.Module], config, extensions: Sequence[str]) -> None:
    """Raises: ValueError as `build`."""
    known = EXTENSIONS[paper_class(model_class)]
    own = model_class not in EXTENDED
    if own and extensions and not issubclass(model_class, Extended):
        base, name = EXTENDED.get(paper_class(model_class)), model_class.__name__
        how = f"derive it from dancediff.extensions.networks.{base.__name__}, or " if base else ""
        raise ValueError(f"extensions: {name} takes none; {how}name none")
    for name in extensions:
        if name not in known:
            raise ValueError(
                f"extensions: {name!r} is not one of those of {model_class.__name__}: "
                f"{', '.join(known)}"
            )
        for needed in REGISTRY[name].needs:
            if needed not in extensions:
                raise ValueError(f"extensions: {name!r} needs {needed!r}; name it, too")
    if "formation_prior" in extensions and "dancer_positioning" in config.without:
        raise ValueError(
            "extensions: 'formation_prior' is a linear guess by rank, which a model "
            "without 'dancer_positioning' does not know"
        )


def paper_class(model_class: type[nn.Module]) -> type[nn.Module]:
    """The network of a paper that a class is, or that it is derived from.

    >>> paper_class(ExtendedEDGE).__name__
    'EDGE'
    """
    return next(one for one in FAMILIES if issubclass(model_class, one))


def extensions_of(model: nn.Module) -> tuple[str, ...]:
    """Names of a model's extensions; none of a plain one."""
    return getattr(model, "extensions", ())
