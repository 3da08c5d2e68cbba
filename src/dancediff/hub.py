r"""Model folders: save, load, and the models and the song that come with the package.

Read first: `dancediff.generation.pipeline`.

A model folder holds ``config.json`` (class, sizes, names of extensions and genres),
``model.safetensors`` (weights and normalisers) and ``card.md``; a Lodge has ``global.safetensors``
and ``local.safetensors`` instead. No pickle is ever read, and no code that a folder names is run
unless the caller names it, too. Files are written under a temporary name
and renamed, so a stop in between leaves the old file or the new one.
"""

import json
import re
import warnings
from collections.abc import Callable
from dataclasses import asdict, is_dataclass
from functools import partial
from os import PathLike
from pathlib import Path

import numpy as np
import torch
from safetensors import SafetensorError
from safetensors.torch import load_file

from dancediff import __version__
from dancediff.atomic import save_tensors, tensor_name, write_text
from dancediff.extensions.build import NETWORKS, build, extensions_of, paper_class
from dancediff.extensions.genre_condition import genres_of
from dancediff.extensions.own_network import class_name, own_network
from dancediff.generation.pipeline import Network, Pipeline, pipeline_of, unusable
from dancediff.music.song import Music
from dancediff.nn.sizes import check_sizes
from dancediff.own import is_own

ASSETS = Path(__file__).parent / "assets"
SONG = "studio_floor"
_FILES = {"Lodge": {"global": "global_stage.", "local": "local_stage."}}  # whose weights lie where
_ONE_FILE = {"model": ""}


def save_model(model: Network, folder, *, card: str = "", dtype=torch.float16) -> Path:
    """Write a model folder; weights in ``dtype``, normalisers always in full precision.

    Raises: ValueError when a weight is not finite, or too large for ``dtype``.
    """
    kind = class_name(type(model))
    config: dict = {"class": kind, "dancediff": __version__, "config": asdict(model.config)}
    config["extensions"] = names = list(extensions_of(model))
    if "genre_condition" in names:
        config["genres"] = list(genres_of(model))
    tensors = {
        k: (v if "normalizer" in k else v.to(dtype)).detach().cpu().contiguous().clone()
        for k, v in model.state_dict().items()
    }
    for key, value in tensors.items():
        if not value.isfinite().all():
            raise ValueError(f"model: {key} is not finite in {dtype}; train it again or save fp32")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    files = _FILES.get(kind, _ONE_FILE)
    for name, prefix in files.items():
        save_tensors(_under(tensors, prefix), folder / f"{name}.safetensors")
    sizes = json.dumps(config, indent=2, default=np.generic.item)  # some may be numpy's
    for name, text in (("config.json", sizes + "\n"), ("card.md", card)):
        write_text(folder / name, text)
    for name in {*_ONE_FILE, *(name for some in _FILES.values() for name in some)} - {*files}:
        (folder / f"{name}.safetensors").unlink(missing_ok=True)  # of a model of another kind
    return folder


def packaged_models() -> list[str]:
    """Names of the models that come with the package.

    >>> "tcdiffpp" in packaged_models()
    True
    """
    return sorted(path.parent.name for path in ASSETS.glob("models/*/config.json"))


def packaged_song() -> Music:
    """The short CC0 song that comes with the package.

    >>> packaged_song().name
    'studio_floor'
    """
    return Music.load(ASSETS / "songs" / f"{SONG}.ogg")


def model_folder(name) -> Path:
    """Where a packaged model lies, or the model folder itself.

    Raises: ValueError naming the packaged ones when it is neither.

    >>> model_folder("tcdiffpp").name
    'tcdiffpp'
    """
    if not isinstance(name, str | PathLike):
        raise ValueError(f"model {name!r} is no name; {_choices()}")
    folder = ASSETS / "models" / str(name) if str(name) in packaged_models() else Path(name)
    if not (folder / "config.json").is_file():
        if (folder / "model" / "config.json").is_file():  # the folder of a training
            raise ValueError(
                f"model {str(name)!r} is no model folder, but holds one; did you mean "
                f"{str(folder / 'model')!r}?"
            )
        raise ValueError(
            f"model {str(name)!r} is neither packaged nor a model folder; {_choices()}"
        )
    return folder


def _choices() -> str:
    known = ", ".join(packaged_models()) or "none"
    return f"choose a packaged one ({known}) or a folder with a config.json"


def load(name, *, device: str = "cpu", own: str | type | None = None) -> Pipeline:
    """Load a packaged model by name, or a model folder by path; ``.model`` is the network.

    ``own``: the class of a network that is not of this package, or its name "module:Class". The
    folder's own word for it is never enough: to import it would run its author's code.

    Raises: ValueError naming what is wrong with it and which names there are.

    >>> load("tcdiffpp").config.max_dancers
    5
    """
    folder = model_folder(name)
    try:
        model = _read(folder, own)
    except _Unfit as err:
        raise ValueError(f"model folder {str(folder)!r} cannot be read: {err}") from err
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as err:
        raise ValueError(
            f"model folder {str(folder)!r} cannot be read: {err}; train or copy it again"
        ) from err
    try:
        return pipeline_of(model.to(device).eval(), folder.name)
    except (RuntimeError, AssertionError, TypeError) as err:
        raise unusable(device, err) from err


class _Unfit(ValueError):
    """Training again would not help; the message says what does."""


def _classes(kind, own: str | type | None) -> tuple[type, type]:
    """The class of a folder's network, and that of its sizes."""
    if not is_own(kind):
        if kind not in NETWORKS:
            raise ValueError(f"class {kind!r} is not one of {', '.join(NETWORKS)}")
        return NETWORKS[kind]
    if own is None:
        raise _Unfit(
            f"its network is the class {kind!r}, code that does not come with dancediff and is not "
            f"run unasked; if you trust it, pass own={kind!r} (--own {kind})"
        )
    try:
        model_class = own_network(own)
    except ValueError as err:
        raise _Unfit(str(err)) from err
    usual = NETWORKS[paper_class(model_class).__name__][1]
    return model_class, getattr(model_class, "config_class", usual)


def _numbers(version) -> list[int]:
    """What two versions are compared by.

    >>> _numbers("0.10.0") > _numbers("0.9"), _numbers(None)
    (True, [])
    """
    return [int(part) for part in re.findall(r"\d+", str(version))[:3]]


def _read(folder: Path, own: str | type | None = None) -> Network:
    text = (folder / "config.json").read_text(encoding="utf-8")
    try:
        stored = json.loads(text)
    except ValueError as err:
        said = f"is no JSON ({err})" if text.strip() else "is empty"
        raise ValueError(f"config.json {said}") from err
    if not isinstance(stored, dict):
        raise ValueError(f"config.json holds {type(stored).__name__}, not a table of names")
    for name in ("class", "config"):
        if name not in stored:
            raise ValueError(f"config.json names no {name}")
    if _numbers(stored.get("dancediff")) > _numbers(__version__):
        which = f"model folder {str(folder)!r} is of dancediff {stored['dancediff']}, this is "
        warnings.warn(f"{which}{__version__}; update it if they do not fit", stacklevel=4)
    model_class, config_class = _classes(stored["class"], own)
    if "extensions" not in stored:
        raise ValueError("config.json names no extensions: an older dancediff wrote it")
    names = _checked("extensions", stored["extensions"], tuple)
    make: Callable[..., Network] = partial(build, model_class, extensions=names)
    if "genre_condition" in names:
        make = partial(make, genres=_checked("genres", stored.get("genres"), tuple))
    config = _config(stored["config"], config_class())
    tensors = {
        prefix + tensor_name(key): value
        for name, prefix in _FILES.get(stored["class"], _ONE_FILE).items()
        for key, value in load_file(folder / f"{name}.safetensors").items()
    }
    with torch.device("meta"):  # takes no memory, however much the config asks for
        wanted = make(config).state_dict()
    _check_shapes(tensors, wanted, model_class)
    for key in sorted(tensors):
        if not tensors[key].isfinite().all():
            raise ValueError(f"{key} holds values that are no finite numbers")
    with torch.random.fork_rng(devices=[]):  # weights are drawn, and then replaced by those there
        model = make(config)
    model.load_state_dict({key: value.float() for key, value in tensors.items()})
    return model


def _check_shapes(tensors: dict, wanted: dict, model_class: type) -> None:
    """Refuse weights of another network, and say which of its parts differs, and how."""
    for key in sorted(wanted.keys() | tensors.keys()):
        have, want = (tuple(d[key].shape) if key in d else None for d in (tensors, wanted))
        if have == want:
            continue
        part, who = key.rpartition(".")[0] or key, model_class.__name__
        why = f"a training with other sizes, or another version of {who}, wrote them"
        if have is None:
            why = f"{who} has a part that was not there in training"
        elif want is None:
            why = f"{who} does not have this part, which was there in training"
        raise _Unfit(
            f"part {part!r} does not fit: {key} has shape {have} in the weights, {want} by "
            f"config.json and {who}; {why}. Use the config.json and the class of the training"
        )


def _under(tensors: dict, prefix: str) -> dict:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}


def _config(stored: dict, defaults):
    """The config that was stored, of the class of ``defaults``; every entry is checked first."""
    values = {}
    if not isinstance(stored, dict):
        raise ValueError(f"config is a {type(stored).__name__}; expected names with their values")
    for key, value in stored.items():
        if key not in vars(defaults):
            raise ValueError(f"config has an unknown entry {key!r}")
        default = getattr(defaults, key)
        if is_dataclass(default):
            values[key] = _config(value, default)
        else:
            values[key] = _checked(key, value, type(default))
    return type(defaults)(**values)


def _checked(key: str, value, kind: type):
    if kind is tuple:
        if type(value) is not list or not all(type(name) is str for name in value):
            raise ValueError(f"config {key}={value!r} should be a list of names")
        return tuple(value)
    if kind is not float and type(value) is not kind:
        raise ValueError(f"config {key}={value!r} should be {kind.__name__}")
    check_sizes({key: value}, "config")
    return value
