r"""What an ablation compares: one TOML file with the tables of a training config and three more.

Read first: `dancediff.training.config`.

``held_out`` says which songs are danced to in the end (`HeldOut`), ``sample`` how (options of
`generate`), and ``variants.NAME`` which keys of the other tables a variant changes. ``seeds = [0,
1, 2]`` at the top trains and samples every variant that often.

A variant that switches to another ``class`` of model keeps the sizes, weights of losses, extensions
and options that both have. With ``class = "Lodge"`` the tables are those of
`dancediff.training.lodge`.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, fields, replace
from hashlib import sha256

from dancediff.data.choreographed import SIZES
from dancediff.extensions.build import EXTENSIONS, paper_class
from dancediff.extensions.build import FAMILIES as OF_NETWORKS
from dancediff.extensions.own_network import own_network
from dancediff.extensions.registry import REGISTRY
from dancediff.generation.dance_request import DanceRequest
from dancediff.generation.request import REQUESTS, default_of, request_of
from dancediff.own import is_own, own_digests, own_function
from dancediff.training.config import (
    LARGEST_SEED,
    SHORTEST_SYNTHETIC,
    GroupData,
    SoloData,
    TrainingExtensions,
)
from dancediff.training.lodge import STAGES, check_lodge_tables, is_lodge, stage_config
from dancediff.training.run import MODELS, NAMES, check_tables, network_classes, objective_class
from dancediff.training.tables import check_table, read_toml

SEED_STRIDE = 100_000  # more than there are held-out songs: no song meets the same noise twice
FIRST_SEED = 1_000_000  # of the held-out songs; those of the training set begin at 0
PROTOCOL = 2  # counts up when dances are asked for otherwise: those that are kept are made anew
REFERENCE_SEED = 2_000_000  # of the songs of the reference set
CHOREOGRAPHER = "choreographer"  # the row of the dances that were made, not learned
FAMILIES = {network.__name__: family for network, family in OF_NETWORKS.items()}
_FIXED = ("data", "held_out")  # all variants are measured on the same songs


@dataclass(frozen=True)
class HeldOut:
    """The songs that are danced to; training never hears them.

    Raises: ValueError naming the key, its value and what is allowed.
    """

    songs: int = 10
    seconds: float = 24.0  # 720 frames, the paper's evaluation length
    dancers: int = default_of("tcdiffpp", "dancers")
    reference: int = 100  # other songs, whose dances are the reference set of FID and the like
    metrics: tuple[str, ...] = ()  # of your own, each "module:function"

    def __post_init__(self):
        for name in self.metrics:
            own_function(name, "metrics")
        for name in ("songs", "reference"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}={getattr(self, name)} must be above 0")
        if self.dancers not in SIZES:
            raise ValueError(f"dancers={self.dancers} must lie in 1 ... {max(SIZES)}")
        if not self.seconds >= SHORTEST_SYNTHETIC:
            raise ValueError(
                f"seconds={self.seconds} must be at least {SHORTEST_SYNTHETIC:g}: 4 beats"
            )

    def facts(self) -> dict:
        """What its dances depend on."""
        facts = {key: value for key, value in asdict(self).items() if key != "metrics"}
        return facts | {"protocol": PROTOCOL}

    @property
    def seeds(self) -> range:
        """Of the songs."""
        return range(FIRST_SEED, FIRST_SEED + self.songs)

    @property
    def reference_seeds(self) -> range:
        """Of the songs that the reference set dances to."""
        return range(REFERENCE_SEED, REFERENCE_SEED + self.reference)


@dataclass(frozen=True)
class Variant:
    """One row of the table: its name, the tables it is trained with and how it dances."""

    name: str
    tables: dict = field(repr=False)
    sample: DanceRequest  # song i is danced with seed + i
    held_out: HeldOut
    of: str = ""  # what several seeds are seeds of
    own: dict = field(default_factory=dict, repr=False)  # hashes of the user's own code, by name

    @property
    def training(self) -> str:
        """Name of the training's folder; variants with the same tables share it."""
        return self._key(self.tables, _trained_with(self.tables))

    @property
    def dances_key(self) -> str:
        """Changes with everything that its dances depend on."""
        asked = {name: value for name, value in self.sample.asked().items() if name != "device"}
        names = [*_trained_with(self.tables), asked.get("sampler")]
        return self._key([self.tables, asked, self.held_out.facts()], names)

    @property
    def scores_key(self) -> str:
        """Changes with everything that its scores depend on."""
        return self.key_with_metrics(self.dances_key)

    def key_with_metrics(self, key: str) -> str:
        """Changes with the metrics, too: what was measured, not only what was danced."""
        metrics = self.held_out.metrics
        return self._key([key, metrics], metrics) if metrics else key

    def _key(self, value, names: Iterable) -> str:
        """`key_of`, which changes with the user's own code of these names, too."""
        own = {name: self.own[name] for name in names if name in self.own}
        return key_of([value, own] if own else value)


def key_of(value) -> str:
    """A short name for a value made of lists, dicts, numbers, strings and dates, as TOML has them.

    >>> key_of({"a": 1, "b": 2}) == key_of({"b": 2, "a": 1}) != key_of({"a": 1, "b": 3})
    True
    """
    return sha256(json.dumps(value, sort_keys=True, default=str).encode()).hexdigest()[:12]


def read_ablation(path) -> list[Variant]:
    """Read and check all variants of a config.

    Raises: ValueError naming the file, the variant, the table and the key that does not fit.
    """
    config, source = read_toml(path), repr(str(path))
    variants, seeds = config.pop("variants", {}), config.pop("seeds", None)
    if seeds is not None and not (isinstance(seeds, list) and seeds and _are_seeds(seeds)):
        raise ValueError(
            f"{source}: seeds={seeds!r} must be different whole numbers in 0 ... "
            f"{LARGEST_SEED - 1}, as [0, 1, 2]"
        )
    if not isinstance(variants, dict) or not variants:
        raise ValueError(f"{source} has no [variants.NAME]; add one, it may be empty")
    for table, values in config.items():
        if not isinstance(values, dict):
            raise ValueError(f"{source}: {table!r} is no table; write [{table}]")
    found = [_variant(name, changes, config, source) for name, changes in variants.items()]
    # seed by seed: all variants have one before any has two
    return found if seeds is None else [_seeded(v, seed) for seed in seeds for v in found]


def _are_seeds(values: list) -> bool:
    """Are these whole numbers that training takes, none of them twice?"""
    whole = all(type(value) is int and 0 <= value < LARGEST_SEED for value in values)
    return whole and len(set(values)) == len(values)


def _seeded(variant: Variant, seed: int) -> Variant:
    """The variant, trained and sampled with other random numbers."""
    tables = variant.tables | {"train": variant.tables["train"] | {"seed": seed}}
    sample = replace(variant.sample, seed=variant.sample.seed + SEED_STRIDE * seed)
    name = f"{variant.name}-seed-{seed}"
    return replace(variant, name=name, tables=tables, sample=sample, of=variant.name)


def _variant(name: str, changes: dict, config: dict, source: str) -> Variant:
    """One variant of the config, checked."""
    _check_changes(name, changes, source)
    source = f"{source}, variant {name!r}"
    usual = config.get("model", {}).get("class", "TCDiffPP")
    kind = changes.get("model", {}).get("class", usual)
    paper = _paper(kind, source)
    base = config if paper == _paper(usual, source) else _shared(config, kind, paper)
    merged = {table: base.get(table, {}) | changes.get(table, {}) for table in base | changes}
    held_out, sample = merged.pop("held_out", {}), merged.pop("sample", {})
    held_out = HeldOut(**check_table(held_out, HeldOut, f"{source}: 'held_out'"))
    tables = _checked(merged, held_out, source)
    request = _sample(sample, kind, paper, held_out, source)
    names = [*_trained_with(tables), getattr(request, "sampler", None), *held_out.metrics]
    return Variant(name, tables, request, held_out, own=own_digests(names))


def _trained_with(tables: dict) -> list:
    """What may name code of the user's own in the tables of a training."""
    return [tables["model"].get("class"), tables["extensions"].get("own_loss")]


def _check_changes(name: str, changes, source: str) -> None:
    """Is this a name, and are these tables that a variant may change?"""
    if not name.replace("-", "_").isidentifier() or name == CHOREOGRAPHER:
        raise ValueError(f"{source}: variant {name!r} is no name; use a-z, 0-9, _ and -")
    if not isinstance(changes, dict):
        raise ValueError(f"{source}: variant {name!r} is no table; write [variants.{name}]")
    for table, values in changes.items():
        if table in _FIXED:
            raise ValueError(f"{source}: variant {name!r} changes {table!r}, the same for all")
        if not isinstance(values, dict):
            raise ValueError(f"{source}, variant {name!r}: {table!r} is no table")


def _shared(config: dict, kind, paper: str) -> dict:
    """The config with those keys only that the network of another paper has, too."""
    if paper not in MODELS:  # Lodge has tables of its own
        return config
    model_class, config_class = network_classes(kind)
    known = {
        "model": {*_names(config_class), *NAMES},
        "weights": _names(objective_class(model_class).weights),
        "extensions": [name for name in _names(TrainingExtensions) if _goes_with(name, paper)],
        "sample": REQUESTS[FAMILIES[paper]].names(),
    }
    kept = {
        table: {key: value for key, value in config.get(table, {}).items() if key in names}
        for table, names in known.items()
    }
    extensions = kept["model"].get("extensions", [])
    if isinstance(extensions, list):
        possible = EXTENSIONS[MODELS[paper][0]]
        kept["model"]["extensions"] = [one for one in extensions if one in possible]
    return config | kept


def _goes_with(name: str, paper: str) -> bool:
    """Can a paper's network be trained with a key of [extensions]? All can with an own loss."""
    return name not in REGISTRY or FAMILIES[paper] in REGISTRY[name].models


def _names(config_class: type) -> list[str]:
    return [one.name for one in fields(config_class)]


def _sample(options: dict, kind, paper: str, held_out: HeldOut, source: str) -> DanceRequest:
    """How a variant dances; how long, and how many, is that of the held-out songs."""
    for key in ("dancers", "seconds", "genre"):
        if key in options:
            raise ValueError(f"{source}: 'sample': {key} is that of 'held_out'")
    given = {key: value for key, value in options.items() if value != []}  # taken back
    given |= {"dancers": held_out.dancers, "seconds": held_out.seconds}
    try:
        return request_of(FAMILIES[paper], kind, given)
    except ValueError as err:
        raise ValueError(f"{source}: 'sample': {err}") from err


def _paper(kind, source: str) -> str:
    """The paper's network that a config's ``class`` is, or is derived from."""
    if not is_own(kind):
        return kind if isinstance(kind, str) else ""
    try:
        return paper_class(own_network(kind)).__name__
    except ValueError as err:
        raise ValueError(f"{source}: {err}") from err


def _checked(merged: dict, held_out: HeldOut, source: str) -> dict:
    """The tables of a training whose songs are others than those held out."""
    lodge = is_lodge(merged)
    tables = check_lodge_tables(merged, source) if lodge else check_tables(merged, source)
    if lodge:
        if held_out.dancers != 1:
            raise ValueError(
                f"{source}: held_out dancers={held_out.dancers} must be 1: "
                "Lodge is trained on solos"
            )
        for stage in STAGES:
            stage_config(tables, stage)
    data = (SoloData if lodge else GroupData)(**tables["data"])
    if data.songs > FIRST_SEED:
        raise ValueError(f"{source}: songs={data.songs} of [data] must be at most {FIRST_SEED}")
    return tables
