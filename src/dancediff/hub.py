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
from dancediff.music.song import Music
from dancediff.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

ASSETS = Path(__file__).parent / "assets"
SONG = "studio_floor"
_CLASSES = {"TCDiffPP": (TCDiffPP, TCDiffPPConfig)}
_LARGEST = 4096  # no size in a config is larger; a hostile one could ask for all memory


def save_model(model: TCDiffPP, folder, *, card: str = "", dtype=torch.float16) -> Path:
    """Write a model folder; weights in ``dtype``, normalisers always in full precision."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    config = {
        "class": type(model).__name__,
        "dancediff": __version__,
        "config": asdict(model.config),
    }
    tensors = {
        k: (v if "normalizer" in k else v.to(dtype)).detach().cpu().contiguous().clone()
        for k, v in model.state_dict().items()
    }
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


def load(name, *, device: str = "cpu") -> TCDiffPP:
    """Load a packaged model by name, or a model folder by path.

    Raises: ValueError naming what is wrong with it and which names there are.

    >>> load("tcdiffpp").config.max_dancers
    5
    """
    folder = ASSETS / "models" / str(name)
    if str(name) not in packaged_models():
        folder = Path(name)
    if not (folder / "config.json").is_file():
        known = ", ".join(packaged_models()) or "none"
        raise ValueError(f"model {str(name)!r} is neither packaged ({known}) nor a model folder")
    try:
        stored = json.loads((folder / "config.json").read_text(encoding="utf-8"))
        model_class, config_class = _CLASSES[stored["class"]]
        model = model_class(config_class(**_checked(stored["config"], config_class)))
        model.load_state_dict(
            {k: v.float() for k, v in load_file(folder / "model.safetensors").items()}
        )
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, SafetensorError) as err:
        raise ValueError(f"model folder {str(folder)!r} cannot be read: {err}") from err
    model.name = folder.name
    return model.to(device).eval()


def _checked(config: dict, config_class) -> dict:
    defaults = {f.name: f.default for f in fields(config_class)}
    for key, value in config.items():
        if key not in defaults:
            raise ValueError(f"config has an unknown entry {key!r}")
        kind = type(defaults[key])
        if kind is not float and type(value) is not kind:
            raise ValueError(f"config {key}={value!r} should be {kind.__name__}")
        if kind is int and not 0 < value <= _LARGEST:
            raise ValueError(f"config {key}={value} is not in 1..{_LARGEST}")
    return config
