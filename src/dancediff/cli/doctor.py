"""`dancediff doctor`: what is installed, what works when it is tried, and how to mend the rest.

Read first: `dancediff.cli.commands`.
"""

import importlib.metadata
import importlib.util
import os
import platform
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from dancediff.cli.files import EXTRAS, tell

VERSIONS = ("dancediff", "torch", "numpy", "librosa", "soundfile", *EXTRAS)
SETUP = "python -m pip install -r requirements.txt"


@dataclass
class Doctor:
    """Say which versions are here, try what dancediff needs, and name the fix for what fails."""

    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """A line a check; the exit status is 0 unless something that every dance needs fails."""
        facts: dict = {"python": platform.python_version()}
        versions = {name: version(name) for name in VERSIONS}
        lines = [
            f"python {facts['python']}",
            " · ".join(f"{name} {words}" for name, words in versions.items() if words),
        ]
        failed = []
        for name, (check, fix) in CHECKS.items():
            try:
                found, mark = check(), "✓"
            except Exception as err:  # whatever is broken here is what we are asked about
                found, mark = f"{type(err).__name__}: {err}", "✗"
                found += f"; {fix}"
                failed += [name] if fix == SETUP else []
            facts[name] = {"works": mark == "✓", "found": found}
            lines.append(f"{mark} {name}: {found}")
        tell(self.json, versions | facts, lines)
        if failed:
            raise RuntimeError(f"{', '.join(failed)} did not work; see above for the fix")


def version(name: str) -> str | None:
    """The version that is installed, if any is."""
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return None


def machine() -> str:
    """System, processor, cores, what torch makes of the processor, and a GPU if there is one.

    >>> "cores" in machine()
    True
    """
    import torch

    gpu = torch.cuda.get_device_name(0) if torch.cuda.is_available() else "no GPU"
    return (
        f"{platform.system()} {platform.machine()}, {os.cpu_count()} cores "
        f"({torch.backends.cpu.get_cpu_capability()}), {gpu}"
    )


def digits() -> str:
    """Which precision is faster on this processor?"""
    from dancediff.nn.precision import fastest_dtype

    fastest = str(fastest_dtype("cpu")).removeprefix("torch.")
    return f"{fastest} is fastest here (--dtype fastest)"


def sound() -> str:
    """Write and read a second of every kind of sound file."""
    import numpy as np

    from dancediff.music.song import Music

    noise = np.random.default_rng(0).normal(0, 0.1, 22050).astype(np.float32)
    suffixes = ("wav", "flac", "ogg", "mp3")
    with tempfile.TemporaryDirectory() as folder:
        for suffix in suffixes:
            path = Path(folder) / f"a.{suffix}"
            Music(noise, 22050, "a").save(path)
            Music.load(path)
    return f"{', '.join(suffixes)} can be read"


def models() -> str:
    """Load every model of the package."""
    from dancediff import hub

    names = hub.packaged_models()
    weights = [sum(p.numel() for p in hub.load(name).model.parameters()) / 1e6 for name in names]
    words = (f"{name} ({m:.1f} million weights)" for name, m in zip(names, weights, strict=True))
    return ", ".join(words)


def dancing() -> str:
    """Two seconds of two dancers, to noise."""
    import numpy as np

    from dancediff import hub
    from dancediff.music.song import Music

    noise = np.random.default_rng(0).normal(0, 0.1, 2 * 22050).astype(np.float32)
    model, begun = hub.load("tcdiffpp"), time.perf_counter()
    model.generate(Music(noise, 22050, "noise"), dancers=2, seconds=2, steps=2)
    return f"2 s of two dancers, 2 steps, in {time.perf_counter() - begun:.1f} s"


def video() -> str:
    """Is there an encoder for H.264 and one for AAC?"""
    import av

    for codec in ("libx264", "aac"):
        av.Codec(codec, "w")
    return ".mp4 with sound"


def models_in_3d() -> str:
    """Is the library there that writes .glb?"""
    import pygltflib

    return f".glb by pygltflib {pygltflib.__version__}"


def lessons() -> str:
    """Is all there that a notebook with a stage needs?"""
    missing = [
        name
        for name in ("jupyterlab", "ipywidgets", "pythreejs", "nbval")
        if importlib.util.find_spec(name) is None
    ]
    if missing:
        raise ImportError(f"{', '.join(missing)} missing")
    return "JupyterLab with widgets and stage"


CHECKS: dict[str, tuple[Callable[[], str], str]] = {  # what to try, and what to do if it fails
    "machine": (machine, SETUP),
    "sound": (sound, SETUP),
    "models": (models, SETUP),
    "dancing": (dancing, SETUP),
    "precision": (digits, SETUP),
    "video": (video, 'pip install "dancediff[video]", or save .gif'),
    "3-D files": (models_in_3d, 'pip install "dancediff[gltf]"'),
    "lessons": (lessons, 'pip install "dancediff[notebooks]"'),
}
