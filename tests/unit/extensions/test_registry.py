"""The registry of extensions against modules, presets and lessons."""

from importlib import import_module
from pathlib import Path

import pytest

import dancediff.extensions
from dancediff.extensions.registry import KINDS, REGISTRY, SHARED
from dancediff.generation.presets import PRESETS
from places import ROOT

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
    for name in extension.needs:
        assert set(extension.models) <= set(REGISTRY[name].models)
        for preset in extension.presets:
            assert preset in REGISTRY[name].presets
    assert set(extension.presets) <= set(PRESETS) - {"paper"}
    if extension.lesson is not None:
        assert list((ROOT / "notebooks").glob(f"{extension.lesson:02d}_*.ipynb"))


def on(value) -> bool:
    return value is True or value not in (False, 1.0)


@pytest.mark.parametrize("preset", PRESETS)
def test_presets_have_what_the_registry_says(preset):
    for model, options in PRESETS[preset].items():
        for option, value in options.items():
            extension = REGISTRY.get(OPTIONS.get(option, option))
            if extension is not None and model in extension.models:
                assert on(value) == (preset in extension.presets), (model, option)
