"""What is named is what runs: training and dancing enter every name of docs/symbols.md.

One step of training of each system, dances of the packaged models, and a recording made ready for
training, with every call noted. A name that only tests or lessons call would teach what the models
do not do.
"""

import re
import sys
import types
from importlib import import_module

import pytest

import dancediff as dd
from dancediff.data.bvh import read_bvh
from dancediff.data.retarget import retarget
from dancediff.genre import GENRES
from dancediff.training.run import train_from_config
from places import ROOT

SYMBOLS = (ROOT / "docs" / "symbols.md").read_text(encoding="utf-8")
NAMES = sorted(set(re.findall(r"\| `(dancediff\.[\w.]+)` \|$", SYMBOLS, re.MULTILINE)))
NOT_CALLED = {"dancediff.motion.representation.TCDIFFPP"}  # a value, no function or class
NOT_REACHED: set[str] = set()
SMALL = "d_model = 32\nnum_heads = 2\nnum_layers = 1\nff_dim = 32\n"
TRAINED = {
    "tcdiffpp": f"[data]\nsongs = 1\nseconds = 8.0\n[model]\n{SMALL}fusion_hidden = 32\n",
    "edge": f'[data]\nsongs = 1\nseconds = 8.0\n[model]\nclass = "EDGE"\n{SMALL}',
    "lodge": f'[data]\nsongs = 1\nseconds = 38.0\nwindows_per_batch = 2\n[model]\nclass = "Lodge"\n'
    f"[global_stage]\n{SMALL}[local_stage]\n{SMALL}genres = {list(GENRES)!r}\n"
    "[weights_fine_tune]\njvel = 0.1\njacc = 0.1\ncontact = 0.1\n"
    "[discriminator]\nd_model = 32\nnum_heads = 2\nnum_layers = 1\n",
}
STEP = "[train]\nsteps = 1\nwarmup = 0\n"


@pytest.fixture(scope="module")
def entered(tmp_path_factory) -> set[types.CodeType]:
    """All code that was entered by training and dancing."""
    seen: set[types.CodeType] = set()
    folder = tmp_path_factory.mktemp("reached")
    song = dd.packaged_song()

    def note(frame, event, _):
        if event == "call":
            seen.add(frame.f_code)

    sys.setprofile(note)
    try:
        for name, config in TRAINED.items():
            path = folder / f"{name}.toml"
            path.write_text(config + STEP)
            train_from_config(path, folder / name)
        short = {"steps": 4, "seed": 0}
        dd.load("tcdiffpp").generate(song, dancers=3, seconds=6, swap=[1, 0, 2], **short)
        solo = dd.load("tcdiffpp").generate(song, dancers=1, seconds=6, sampler="ddim", **short)
        solo.save(folder / "solo.bvh")
        retarget(read_bvh(folder / "solo.bvh"))
        dd.load("lodge").generate(song, seconds=10, genre="jazz", **short)
    finally:
        sys.setprofile(None)
    return seen


def code_of(name: str) -> set[types.CodeType]:
    """The code of a function, or of the methods that a class defines itself."""
    module, attribute = name.rsplit(".", 1)
    found = getattr(import_module(module), attribute)
    own = vars(found).values() if isinstance(found, type) else [found]
    own = [getattr(one, "__func__", getattr(one, "fget", one)) for one in own]
    return {one.__code__ for one in own if isinstance(one, types.FunctionType)}


def reached(name: str, entered: set[types.CodeType]) -> bool:
    return bool(code_of(name) & entered)


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(set(NAMES) - NOT_CALLED))
def test_training_and_dancing_enter_it(name, entered):
    if name in NOT_REACHED:
        assert not reached(name, entered), f"{name} is reached now: take it off the list"
    else:
        assert reached(name, entered)


@pytest.mark.slow
def test_a_name_that_nothing_calls_is_noticed(entered):
    assert len(NAMES) > 40
    assert not reached("dancediff.metrics.group.gmr", entered)
