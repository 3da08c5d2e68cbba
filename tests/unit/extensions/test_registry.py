"""The registry of extensions against modules, presets and lessons."""

import json
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace

import pytest
import torch

import dancediff.extensions
from dancediff import hub
from dancediff.extensions.build import EXTENSIONS
from dancediff.extensions.control import NearbyFrames
from dancediff.extensions.parts import Parts
from dancediff.extensions.registry import KINDS, REGISTRY, SHARED
from dancediff.generation.lodge_dance import LodgeSampler
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.presets import PRESETS
from dancediff.generation.tcdiffpp_dance import hooks_of
from dancediff.papers.tcdiffpp.model import TCDiffPP
from places import ROOT
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp

FOLDER = Path(dancediff.extensions.__file__).parent
OPTIONS = {"foot_contact": "foot_contact_projection"}  # where an option has another name


def test_every_module_is_in_the_registry_and_the_other_way_round():
    modules = {path.stem for path in FOLDER.glob("*.py")} - {"__init__", *SHARED}
    listed = {extension.module for extension in REGISTRY.values()}
    assert {name for name in listed if "." not in name} == modules
    for name in listed:
        import_module(f"dancediff.{name if '.' in name else f'extensions.{name}'}")


@pytest.mark.parametrize("extension", REGISTRY.values(), ids=lambda e: e.name)
def test_an_entry_is_sound(extension):
    assert (
        extension.kind in KINDS
        and extension.summary.endswith(".")
        and "\n" not in extension.summary
    )
    assert set(extension.packaged or ()) <= set(extension.models)
    for name in extension.needs:
        assert set(extension.models) <= set(REGISTRY[name].models)
        for model in filter(extension.packaged_in, extension.models):
            assert REGISTRY[name].packaged_in(model)


@pytest.mark.parametrize("model", hub.packaged_models())
def test_packaged_networks_have_what_the_registry_says(model):
    config = json.loads((hub.model_folder(model) / "config.json").read_text(encoding="utf-8"))
    networks = [name for name, one in REGISTRY.items() if one.kind == "network"]
    says = {name for name in networks if REGISTRY[name].packaged_in(model)}
    assert says == set(config["extensions"])


def named_in(lesson: str, extension) -> bool:
    return any(name in lesson for name in (extension.name, extension.module.rsplit(".", 1)[-1]))


@pytest.mark.parametrize("extension", REGISTRY.values(), ids=lambda e: e.name)
def test_the_lesson_names_what_it_shows(extension):
    if extension.lesson is not None:
        (notebook,) = (ROOT / "notebooks").glob(f"{extension.lesson:02d}_*.ipynb")
        cells = json.loads(notebook.read_text(encoding="utf-8"))["cells"]
        assert named_in("".join("".join(cell["source"]) for cell in cells), extension)


def test_a_lesson_without_the_name_is_noticed():
    assert not named_in("feet that stand", REGISTRY["floor_contact"])


def on(value) -> bool:
    return value is True or value not in (False, 1.0)


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_have_what_the_registry_says(preset):
    for model, options in PRESETS[preset].items():
        for option, value in options.items():
            extension = REGISTRY.get(OPTIONS.get(option, option))
            if extension is not None and model in extension.models:
                usual = preset == "packaged" and extension.packaged_in(model)
                assert on(value) == usual, (model, option)


def hooks_in_registry(model: str) -> list[str]:
    return [e.module for e in REGISTRY.values() if e.kind == "hook" and model in e.models]


def modules_of(hooks: list) -> list[str]:
    """Modules of what acts on a guess, one after the other."""
    parts = [part for hook in hooks for part in getattr(hook, "sources", [hook])]
    parts = [part for part in parts if not isinstance(part, NearbyFrames)]  # part of control
    acting = [step for part in parts for step in getattr(part, "steps", [type(part)])]
    names = [one.__module__.rsplit(".", 1)[1] for one in acting]
    return ["control" if name == "constraint" else name for name in names]


def test_hooks_act_in_the_order_of_the_registry():
    song, trio = hub.packaged_song(), tiny_tcdiffpp()
    lodge = pipeline_of(tiny_lodge(frames=256))
    request = trio.resolve(song, dancers=2, start=[(-1, 0), (1, 0)])
    assert modules_of(hooks_of(trio.model, request, request.constraint())) == hooks_in_registry(
        "tcdiffpp"
    )
    y = torch.zeros(1, 256, 139)
    pin = SimpleNamespace(hard=y.bool(), y=y, hard_frames=y.bool().any(-1))
    stages = (lodge.model.global_stage, lodge.model.local_stage)
    hooks = LodgeSampler(*stages, lodge.resolve(song)).hooks(pin, 0)
    assert modules_of(hooks) == hooks_in_registry("lodge")


@pytest.mark.parametrize("model", [lambda: tiny_tcdiffpp(EXTENSIONS[TCDiffPP]).model, tiny_lodge])
def test_parts_take_turns_in_the_order_of_the_registry(model):
    parts = [m for m in model().modules() if isinstance(m, Parts)]
    assert parts
    for one in parts:
        assert list(one) == [known for known in REGISTRY if known in one]


def test_a_faded_seam_has_no_initial_frames():
    """They hold the context exactly, which a fade would leave again."""
    trio = tiny_tcdiffpp()
    named = {
        seam: modules_of(hooks_of(trio.model, trio.resolve(hub.packaged_song(), seam=seam), None))
        for seam in ("copy", "fade")
    }
    assert set(named["copy"]) - set(named["fade"]) == {"initial_frames"}
