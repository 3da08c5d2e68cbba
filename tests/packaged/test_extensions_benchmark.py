"""Everything that benchmarks/extensions.py switches off is there and can be switched off."""

import importlib.util
import sys

import pytest

from dancediff import hub
from dancediff.extensions.registry import REGISTRY
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
SPEC = importlib.util.spec_from_file_location("extensions", BENCHMARKS / "extensions.py")
BENCHMARK = importlib.util.module_from_spec(SPEC)
sys.modules[SPEC.name] = BENCHMARK  # dataclasses look their module up
SPEC.loader.exec_module(BENCHMARK)
SETTINGS = BENCHMARK.SETTINGS


@pytest.mark.parametrize("name", SETTINGS)
def test_every_switch_is_there(name):
    setting = SETTINGS[name]
    pipeline, song = hub.load(setting.model), setting.song(0, setting.seconds)[0]
    for extension, without in setting.off.items():
        assert setting.model in REGISTRY[extension].models
        with without.change(pipeline.model):
            asked = setting.request(0) | without.options
            pipeline.resolve(song, seconds=setting.seconds, **asked)


def test_what_can_be_switched_off_while_sampling_is():
    off = {(s.model, name) for s in SETTINGS.values() for name in s.off}
    for one in REGISTRY.values():
        if one.kind in ("hook", "guidance", "sampling"):
            for model in filter(one.packaged_in, ("tcdiffpp", "lodge")):
                possible = one.name in ("control", "group_relations")  # nothing without them
                assert possible or (model, one.name) in off, (model, one.name)
