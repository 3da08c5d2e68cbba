r"""What an ablation compares: one TOML file with the tables of a training config and three more.

``held_out`` says which songs are danced to in the end (`HeldOut`), ``sample`` how (options of
`dancediff.generation.request`, as far as a model has them; ``swap = []`` asks for none), and
``variants.NAME`` which keys of ``model``, ``train``, ``weights`` and ``sample`` a variant changes.
``seeds = [0, 1, 2]`` at the top trains and samples every variant that often.
A variant that switches to another ``class`` of model keeps the sizes that both have. With ``class =
"Lodge"`` the tables are those of `dancediff.training.lodge`, for all variants.
"""

import json
from dataclasses import asdict, dataclass, field, fields, replace
from hashlib import sha256

from dancediff.data.choreographed import SIZES
from dancediff.generation.request import (
    EDGERequest,
    GroupDanceRequest,
    LodgeRequest,
    SamplingConfig,
)
from dancediff.training.config import SHORTEST_SONG, GroupData, SoloData
from dancediff.training.lodge import STAGES, check_lodge_tables, is_lodge, stage_config
from dancediff.training.run import MODELS, check_tables
from dancediff.training.tables import check_table, read_toml

SEED_STRIDE = 100_000  # more than there are held-out songs: no song meets the same noise twice
TRUTH = "choreographer"  # the row of the dances that were made, not learned
REQUEST_OF = {"TCDiffPP": GroupDanceRequest, "EDGE": EDGERequest, "Lodge": LodgeRequest}
OF_HELD_OUT = {"dancers", "seconds", "genre"}
_CHANGEABLE = (
    "model",
    "train",
    "weights",
    "extensions",
    "sample",
)  # all are measured on the same songs
_CHANGEABLE_LODGE = (
    *("global_stage", "local_stage", "discriminator", "train", "extensions", "sample"),
    *(f"{table}_{stage}" for table in ("train", "weights") for stage in STAGES),
)


@dataclass(frozen=True)
class HeldOut:
    """The songs that are danced to; training never hears them."""

    songs: int = 10
    first_seed: int = 1_000_000
    seconds: float = 24.0  # 720 frames, the paper's evaluation length
    dancers: int = 3
    reference: int = 40  # training songs whose dances are the reference set of FID and the like

    def __post_init__(self):
        """Catch what would otherwise be noticed after the training."""
        for name in ("songs", "reference"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}={getattr(self, name)} must be above 0")
        if self.dancers not in SIZES:
            raise ValueError(f"dancers={self.dancers} must lie in 1 ... {max(SIZES)}")
        if not self.seconds >= SHORTEST_SONG:
            raise ValueError(f"seconds={self.seconds} must be at least {SHORTEST_SONG:g}: 4 beats")


@dataclass(frozen=True)
class Variant:
    """One row of the table: its name, the tables it is trained with and how it dances."""

    name: str
    tables: dict = field(repr=False)
    sample: SamplingConfig
    held_out: HeldOut
    of: str = ""  # what several seeds are seeds of

    @property
    def training(self) -> str:
        """Name of the training's folder; variants with the same tables share it."""
        return key_of(self.tables)

    @property
    def key(self) -> str:
        """Changes with everything that its dances depend on."""
        return key_of([self.tables, self.sample.facts(), asdict(self.held_out)])


def key_of(value) -> str:
    """A short name for a value made of plain lists, dicts, numbers and strings.

    >>> key_of({"a": 1, "b": 2}) == key_of({"b": 2, "a": 1}) != key_of({"a": 1, "b": 3})
    True
    """
    return sha256(json.dumps(value, sort_keys=True).encode()).hexdigest()[:12]


def read_ablation(path) -> list[Variant]:
    """Read and check all variants of a config.

    Raises: ValueError naming the file, the variant, the table and the key that does not fit.
    """
    config, source = read_toml(path), repr(str(path))
    variants = config.pop("variants", {})
    seeds = config.pop("seeds", None)
    if seeds is not None and not (isinstance(seeds, list) and seeds and _different(seeds)):
        raise ValueError(f"{source}: seeds={seeds!r} must be different whole numbers, as [0, 1, 2]")
    if not isinstance(variants, dict) or not variants:
        raise ValueError(f"{source} has no [variants.NAME]; add one, it may be empty")
    for name, changes in variants.items():
        if not name.replace("-", "_").isidentifier() or name == TRUTH:
            raise ValueError(f"{source}: variant {name!r} is no name; use a-z, 0-9, _ and -")
        if not isinstance(changes, dict):
            raise ValueError(f"{source}: variant {name!r} is no table; write [variants.{name}]")
        changeable = _CHANGEABLE_LODGE if is_lodge(config) else _CHANGEABLE
        for table in changes:
            if table not in changeable:
                allowed = ", ".join(changeable)
                raise ValueError(f"{source}: variant {name!r} changes {table!r}, not {allowed}")
    found = [
        _variant(name, changes, config, f"{source}, variant {name!r}")
        for name, changes in variants.items()
    ]
    # seed by seed: all variants have one before any has two
    return found if seeds is None else [_seeded(v, seed) for seed in seeds for v in found]


def _different(seeds: list) -> bool:
    return len(set(seeds)) == len(seeds) and all(type(seed) is int for seed in seeds)


def _seeded(variant: Variant, seed: int) -> Variant:
    """The variant, trained and sampled with other random numbers."""
    tables = variant.tables | {"train": variant.tables["train"] | {"seed": seed}}
    sample = replace(variant.sample, seed=variant.sample.seed + SEED_STRIDE * seed)
    name = f"{variant.name}-seed-{seed}"
    return replace(variant, name=name, tables=tables, sample=sample, of=variant.name)


def _variant(name: str, changes: dict, config: dict, source: str) -> Variant:
    for table, values in [*config.items(), *changes.items()]:
        if not isinstance(values, dict):
            raise ValueError(f"{source}: {table!r} is no table; write [{table}]")
    lodge = is_lodge(config)
    base = config
    if not lodge:
        base = config | {"model": _shared(config.get("model", {}), changes.get("model", {}))}
    merged = {table: base.get(table, {}) | changes.get(table, {}) for table in base | changes}
    held_out = _options(HeldOut, merged.pop("held_out", {}), f"{source}: 'held_out'")
    options = merged.pop("sample", {})
    tables = check_lodge_tables(merged, source) if lodge else check_tables(merged, source)
    if lodge:
        _check_stages(tables, held_out, source)
    kind = "Lodge" if lodge else tables["model"].get("class", "TCDiffPP")
    sample = _sample(options, kind, held_out, f"{source}: 'sample'")
    corpus = (SoloData if lodge else GroupData)(**tables["data"])
    usual = {key: getattr(corpus, key) for key in ("songs", "first_seed", "seconds")}
    tables["data"] = usual | tables["data"]
    _check_songs(held_out, tables["data"], source)
    return Variant(name, tables, sample, held_out)


def _shared(model: dict, change: dict) -> dict:
    """The base's keys that the variant's class knows, if the variant is of another class."""
    if change.get("class", model.get("class")) == model.get("class"):
        return model
    known = (
        {f.name for f in fields(MODELS[change["class"]][1])} if change["class"] in MODELS else ()
    )
    return {key: value for key, value in model.items() if key in known}


def _check_stages(tables: dict, held_out: HeldOut, source: str) -> None:
    if held_out.dancers != 1:
        raise ValueError(
            f"{source}: held_out dancers={held_out.dancers} must be 1: Lodge is trained on solos"
        )
    for stage in STAGES:
        try:
            stage_config(tables, stage)
        except (TypeError, ValueError) as err:
            raise ValueError(f"{source}: 'train_{stage}': {err}") from err


def _check_songs(held_out: HeldOut, data: dict, source: str) -> None:
    after = data["first_seed"] + data["songs"]
    if data["first_seed"] - held_out.songs < held_out.first_seed < after:
        raise ValueError(
            f"{source}: held_out first_seed={held_out.first_seed} leads to songs of the training "
            f"set; choose {after} or more"
        )
    if held_out.seconds > data["seconds"]:
        raise ValueError(
            f"{source}: held_out seconds={held_out.seconds:g} is longer than the training songs, "
            f"whose dances are the reference; choose at most {data['seconds']:g}"
        )


def _sample(values: dict, kind: str, held_out: HeldOut, source: str) -> SamplingConfig:
    """How a model of this class dances; options that only others have are left out, but a swap."""
    request = REQUEST_OF[kind]
    for name in OF_HELD_OUT & values.keys():
        raise ValueError(f"{source}: {name} is said in 'held_out'")
    others = {name for one in REQUEST_OF.values() for name in one.names()} - set(request.names())
    values = {k: v for k, v in values.items() if k not in others or k == "swap"}
    if values.get("swap") == []:  # for a variant of which nothing can be asked
        del values["swap"]
    try:
        return request.of(kind, values | {"dancers": held_out.dancers, "seconds": held_out.seconds})
    except ValueError as err:
        raise ValueError(f"{source}: {err}") from err


def _options(kind, values: dict, source: str):
    return kind(**check_table(values, kind, source))
