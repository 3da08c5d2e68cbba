r"""Model folders: save, load, and the models and the song that come with the package.

A model folder holds ``config.json`` (class and sizes), ``model.safetensors`` (weights and
normalisers) and ``card.md``. No pickle is ever read. Files are written under a temporary name and
renamed, so a stop in between leaves the old file or the new one.
"""

import json
from dataclasses import asdict, fields
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from dancediff import __version__
from dancediff.baselines.edge import EDGE, EDGEConfig
from dancediff.music.song import Music
from dancediff.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

ASSETS = Path(__file__).parent / "assets"
SONG = "studio_floor"
_CLASSES = {"TCDiffPP": (TCDiffPP, TCDiffPPConfig), "EDGE": (EDGE, EDGEConfig)}
_LARGEST, _MOST_LAYERS = 4096, 64  # a size beyond is a damaged config, not a model


def save_model(model: TCDiffPP | EDGE, folder, *, card: str = "", dtype=torch.float16) -> Path:
    """Write a model folder; weights in ``dtype``, normalisers always in full precision.

    Raises: ValueError when a weight is not finite, or too large for ``dtype``.
    """
    config = {
        "class": type(model).__name__,
        "dancediff": __version__,
        "config": asdict(model.config),
    }
    tensors = {
        k: (v if "normalizer" in k else v.to(dtype)).detach().cpu().contiguous().clone()
        for k, v in model.state_dict().items()
    }
    for key, value in tensors.items():
        if not value.isfinite().all():
            raise ValueError(f"model: {key} is not finite in {dtype}; train it again or save fp32")
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    part = folder / ".model.part"
    try:
        save_file(tensors, part)
        part.replace(folder / "model.safetensors")
        for name, text in (("config.json", json.dumps(config, indent=2) + "\n"), ("card.md", card)):
            part.write_text(text, encoding="utf-8")
            part.replace(folder / name)
    finally:
        part.unlink(missing_ok=True)
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


def load(name, *, device: str = "cpu") -> TCDiffPP | EDGE:
    """Load a packaged model by name, or a model folder by path.

    Raises: ValueError naming what is wrong with it and which names there are.

    >>> load("tcdiffpp").config.max_dancers
    5
    """
    folder = ASSETS / "models" / str(name) if str(name) in packaged_models() else Path(name)
    if not (folder / "config.json").is_file():
        known = ", ".join(packaged_models()) or "none"
        raise ValueError(
            f"model {str(name)!r} is neither packaged ({known}) nor a model folder; "
            "choose one of these names or a folder with a config.json"
        )
    try:
        model = _read(folder)
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as err:
        raise ValueError(
            f"model folder {str(folder)!r} cannot be read: {err}; train or copy it again"
        ) from err
    model.name = folder.name
    try:
        return model.to(device).eval()
    except (RuntimeError, AssertionError) as err:
        raise ValueError(f"device={device!r} cannot be used here: {err}; choose 'cpu'") from err


def _read(folder: Path) -> TCDiffPP | EDGE:
    stored = json.loads((folder / "config.json").read_text(encoding="utf-8"))
    if stored["class"] not in _CLASSES:
        raise ValueError(f"class {stored['class']!r} is not one of {', '.join(_CLASSES)}")
    model_class, config_class = _CLASSES[stored["class"]]
    config = config_class(**_checked(stored["config"], config_class))
    tensors = load_file(folder / "model.safetensors")
    with torch.device("meta"):  # takes no memory, however much the config asks for
        wanted = model_class(config).state_dict()
    for key in sorted(wanted.keys() | tensors.keys()):
        have, want = (tuple(d[key].shape) if key in d else None for d in (tensors, wanted))
        if have != want:
            raise ValueError(f"{key} has shape {have} in the weights, {want} by config.json")
        if not tensors[key].isfinite().all():
            raise ValueError(f"{key} holds values that are no finite numbers")
    model = model_class(config)
    model.load_state_dict({key: value.float() for key, value in tensors.items()})
    return model


def _checked(config: dict, config_class) -> dict:
    defaults = {f.name: f.default for f in fields(config_class)}
    for key, value in config.items():
        if key not in defaults:
            raise ValueError(f"config has an unknown entry {key!r}")
        kind = type(defaults[key])
        if kind is not float and type(value) is not kind:
            raise ValueError(f"config {key}={value!r} should be {kind.__name__}")
        largest = _MOST_LAYERS if key == "num_layers" else _LARGEST
        if kind is int and not 0 < value <= largest:
            raise ValueError(f"config {key}={value} is not in 1..{largest}")
    return config
