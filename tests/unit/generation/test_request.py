"""The request: checked when it is made, filled in once, never changed."""

import ast
import math
import subprocess
import sys
from dataclasses import FrozenInstanceError, dataclass, fields
from types import SimpleNamespace
from typing import get_args

import numpy as np
import pytest
import torch

from dancediff.cli.generate import Generate
from dancediff.cli.options import FIELDS, LEFT_OUT, kind_of
from dancediff.diffusion.long_sampling import SEAMS
from dancediff.diffusion.pinning import MODES
from dancediff.diffusion.samplers import SAMPLERS
from dancediff.extensions.control import WalkAlong
from dancediff.extensions.group_relations import MAX_DANCERS, RELATIONS
from dancediff.extensions.preconditioning import Preconditioning
from dancediff.generation.dance_request import DTYPES
from dancediff.generation.diffusion_request import DiffusionRequest, needs_preconditioning
from dancediff.generation.presets import PACKAGED, PAPER, PRESETS
from dancediff.generation.request import (
    REQUESTS,
    EDGERequest,
    LodgeRequest,
    TCDiffPPRequest,
    default_of,
    request_of,
)
from places import SOURCE
from tiny_lodge import tiny_lodge


@dataclass
class Tune:
    """As much of a song as a request looks at."""

    duration: float = 12.0
    name: str = "tune"
    is_silent: bool = False
    peak: float = 0.5
    tempo: float = 125.0


def model(*, precondition=True, **sizes):
    usual = {"num_frames": 150, "num_steps": 1000, "max_dancers": 5}
    parts = [Preconditioning(8, 1)] if precondition else []
    config = SimpleNamespace(**usual | sizes)
    return SimpleNamespace(config=config, modules=lambda: parts)


@pytest.mark.parametrize("family", REQUESTS)
def test_every_default_stands_once(family):
    """In both presets, or in the dataclass."""
    names = REQUESTS[family].names()
    for preset in PRESETS.values():
        assert set(preset[family]) <= set(names)
    assert PAPER[family].keys() == PACKAGED[family].keys()
    for one in fields(REQUESTS[family]):
        if one.name in PAPER[family]:
            assert one.default is None, f"{one.name} has a default here and in the presets"
    for name, value in PAPER[family].items():  # one that no preset changes needs no preset
        assert value != PACKAGED[family][name], name


@pytest.mark.parametrize("family", REQUESTS)
def test_every_option_says_what_it_does(family):
    for one in fields(REQUESTS[family]):
        assert one.metadata["help"].endswith("."), one.name


def test_the_paper_is_the_papers():
    denoisers = [one for one in REQUESTS if issubclass(REQUESTS[one], DiffusionRequest)]
    for family in denoisers:
        preset = PAPER[family]
        assert [preset[k] for k in ("sampler", "steps", "eta", "guidance")] == ["ddim", 50, 1, 2]
        assert (
            needs_preconditioning(family).items() <= preset.items() and preset["autoguidance"] == 1
        )
        assert not preset["foot_contact"]
    assert PAPER["tcdiffpp"]["pinning"] == "init"


def test_choices_are_those_of_the_code():
    options = TCDiffPPRequest.__dataclass_fields__
    for name, values in {
        "sampler": SAMPLERS,
        "pinning": ("auto", *MODES),
        "seam": tuple(SEAMS),
    }.items():
        assert options[name].metadata["choices"] == values
    assert LodgeRequest.__dataclass_fields__["relation"].metadata["choices"] == RELATIONS
    assert LodgeRequest.__dataclass_fields__["dancers"].metadata["high"] == MAX_DANCERS


def test_a_dtype_is_its_name():
    asked = TCDiffPPRequest(dtype=torch.bfloat16, device=torch.device("cpu"))
    assert asked == TCDiffPPRequest(dtype="bfloat16", device="cpu")
    assert asked.resolve(model(), Tune()).facts()["dtype"] == "bfloat16"
    assert get_args(kind_of(FIELDS["dtype"])) == DTYPES  # on the command line, too
    for other in (torch.float16, "nonsense", 16):
        with pytest.raises(ValueError, match=r"dtype=.* is not one of 'float32', 'bfloat16'"):
            TCDiffPPRequest(dtype=other)


def test_requests_bring_no_torch():
    """The command line shows its options at once."""
    code = "import dancediff.generation.request, sys; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"


def test_the_command_line_has_every_option_and_no_default_of_its_own():
    own = {"songs", "model", "out", "formats", "workers", "backend", "scheduler", "json", "own"}
    command = {one.name: one for one in fields(Generate)}
    names = {name for request in REQUESTS.values() for name in request.names()}
    assert command.keys() == own | names - {"start", "end", "constraints", "seed_motion"}
    given = {name: one.default for name, one in command.items() if name not in own}
    assert given.pop("at_once") == LEFT_OUT  # None is a value of it
    assert set(given.values()) == {None}


def test_resolve_fills_in_everything_once():
    asked = TCDiffPPRequest(seed=3)
    found = asked.resolve(model(), Tune())
    assert asked == TCDiffPPRequest(seed=3)  # nothing was written into it
    for name, value in PACKAGED["tcdiffpp"].items():
        if name in ("genre", "energy"):
            assert getattr(found, name) is None, "the model has no part for it"
        elif name == "genre_guidance":
            assert found.genre_guidance == 1, "nobody asked for a genre"
        elif name != "pinning":
            assert getattr(found, name) == value, name
    assert found.pinning == "same_noise" and found.seconds == 12 and found.frames == 360
    assert found.resolve(model(), Tune()) == found


def test_nothing_can_be_assigned():
    with pytest.raises(FrozenInstanceError):
        TCDiffPPRequest().seed = 3


def test_nobody_gets_around_frozen():
    """``object.__setattr__`` stands in constructors only, all over the package."""
    for path in sorted(SOURCE.rglob("*.py")):
        tree = ast.parse(path.read_text(encoding="utf-8"))
        for function in ast.walk(tree):
            if isinstance(function, ast.FunctionDef) and "object.__setattr__" in ast.unparse(
                ast.Module([n for n in function.body], [])
            ):
                assert function.name in ("__init__", "__post_init__"), f"{path}: {function.name}"


@pytest.mark.parametrize(
    ("sampler", "eta", "pinning"),
    [("dpm", 0.0, "same_noise"), ("ddim", 1.0, "renoise"), ("ddpm", 0.0, "renoise")],
)
def test_pinning_fits_the_sampler(sampler, eta, pinning):
    found = TCDiffPPRequest(sampler=sampler, eta=eta).resolve(model(), Tune())
    assert found.pinning == pinning


def test_what_needs_preconditioning_is_off_without_it():
    plain = model(precondition=False)
    found = TCDiffPPRequest().resolve(plain, Tune())
    assert found.autoguidance == 1 and not found.collision_avoidance and not found.order_constraint
    for asked in ({"collision_avoidance": True}, {"autoguidance": 1.5}):
        with pytest.raises(ValueError, match=f"{next(iter(asked))}=.* with preconditioning"):
            TCDiffPPRequest(**asked).resolve(plain, Tune())
    bare = tiny_lodge(())
    assert LodgeRequest(stage_spots=False).resolve(bare, Tune()).stage_spots is False


def test_what_another_part_of_lodge_rules_out_is_off_without_it():
    """Options that would do nothing, or put dancers beside their spots."""
    thinned = tiny_lodge(first={"variant": "discrete"})
    assert not LodgeRequest().resolve(thinned, Tune()).smooth_primitives
    with pytest.raises(ValueError, match="smooth_primitives=True needs a first stage"):
        LodgeRequest(smooth_primitives=True).resolve(thinned, Tune())
    assert not LodgeRequest(root_stitching=False).resolve(tiny_lodge(), Tune()).stage_spots
    with pytest.raises(ValueError, match="stage_spots=True needs root_stitching=True"):
        LodgeRequest(root_stitching=False, stage_spots=True).resolve(tiny_lodge(), Tune())


def test_preset_and_option_go_together():
    found = TCDiffPPRequest(preset="paper", steps=20).resolve(model(), Tune())
    assert (found.sampler, found.steps, found.pinning) == ("ddim", 20, "init")
    assert default_of("tcdiffpp", "steps", "paper") == 50
    assert default_of("edge", "overlap") == 75


def test_places_at_the_end_are_a_swap():
    end = [(1, 0), (0, 0), (-1, 0)]
    found = TCDiffPPRequest(end=end).resolve(model(), Tune())
    assert found.swap == [2, 1, 0] and found.swap_at == 12
    earlier = TCDiffPPRequest(end=end, swap=[1, 0, 2], swap_at=4).resolve(model(), Tune())
    assert earlier.swap == [1, 0, 2] and earlier.swap_at == 4
    with pytest.raises(ValueError, match=r"swap=\[1, 0, 2\] asks for another order"):
        TCDiffPPRequest(end=end, swap=[1, 0, 2]).resolve(model(), Tune())


def test_constraints_need_pinning_that_holds():
    walk = [WalkAlong(0, [(0, 0, 0), (2, 1, 0)])]
    with pytest.raises(ValueError, match="pinning='init' goes with no constraint"):
        TCDiffPPRequest(preset="paper", constraints=walk).resolve(model(), Tune())


def test_naive_long_sampling_knows_no_rules_of_groups():
    found = TCDiffPPRequest(long_sampling="naive").resolve(model(), Tune())
    assert found.collision_avoidance is False and found.pinning is None
    with pytest.raises(ValueError, match="collision_avoidance=True is not possible"):
        TCDiffPPRequest(long_sampling="naive", collision_avoidance=True).resolve(model(), Tune())
    for name, value in (("pinning", "init"), ("pinning", "auto"), ("seam", "fade")):
        with pytest.raises(ValueError, match=f"{name}='{value}' is not possible.*leave it out"):
            TCDiffPPRequest(long_sampling="naive", **{name: value}).resolve(model(), Tune())
    assert (
        TCDiffPPRequest(long_sampling="naive", preset="paper").resolve(model(), Tune()).seam is None
    )
    with pytest.raises(ValueError, match="start=, end= and constraints= need long_sampling='lgds'"):
        TCDiffPPRequest(dancers=1, long_sampling="naive", start=[(0, 0)]).resolve(model(), Tune())


@pytest.mark.parametrize("value", ["False", "True", 0, 1.0, None])
def test_only_a_bool_is_true_or_false(value):
    """bool("False") is True."""
    if value is None:
        assert TCDiffPPRequest(foot_contact=value).foot_contact is None
        return
    with pytest.raises(ValueError, match=f"foot_contact={value!r} must be True or False"):
        TCDiffPPRequest(foot_contact=value)


def test_lodge_dances_the_genre_of_the_tempo():
    lodge = tiny_lodge(second={"genres": ("hiphop", "house", "salsa")})
    for preset in PRESETS:
        assert LodgeRequest(preset=preset).resolve(lodge, Tune()).genre == "house"
    assert LodgeRequest(genre="salsa").resolve(lodge, Tune()).genre == "salsa"
    for genre in ("waltz", {"house": 1, "waltz": 1}):
        with pytest.raises(ValueError, match="genre='waltz' is unknown; choose one of hiphop"):
            LodgeRequest(genre=genre).resolve(lodge, Tune())
    with pytest.raises(ValueError, match=r"genre='any' is for models .* one of hiphop"):
        LodgeRequest(genre="any").resolve(lodge, Tune())
    with pytest.raises(ValueError, match="formation='circle'"):
        LodgeRequest(dancers=2, formation="circle").resolve(lodge, Tune())


@pytest.mark.parametrize(
    ("request_", "options", "message"),
    [
        (TCDiffPPRequest, {"preset": "best"}, "preset='best' is not one of 'packaged', 'paper'"),
        (TCDiffPPRequest, {"dancers": 0}, "dancers=0 must be a number of at least 1"),
        (TCDiffPPRequest, {"dancers": 2.0}, r"dancers=2\.0 must be an integer"),
        (TCDiffPPRequest, {"dancers": 9}, r"dancers=9 must lie in 1 \.\.\. 5"),
        (TCDiffPPRequest, {"overlap": 150}, r"overlap=150 must lie in 1 \.\.\. 149"),
        (TCDiffPPRequest, {"seed": None}, "seed=None is no value; leave seed out for 0"),
        (TCDiffPPRequest, {"seed": -1}, r"seed=-1 must lie in 0 \.\.\. 9223372036854775807"),
        (TCDiffPPRequest, {"eta": "much"}, "eta='much' must be a number"),
        (TCDiffPPRequest, {"guidance": math.nan}, "guidance=nan must lie in 0"),
        (TCDiffPPRequest, {"seconds": 13}, r"seconds=13 is more than the song's 12\.00"),
        (TCDiffPPRequest, {"seconds": -3}, "seconds=-3 must be"),
        (TCDiffPPRequest, {"swap_at": 3}, r"swap_at=3\.0 needs swap="),
        (
            TCDiffPPRequest,
            {"swap": [1, 0, 2], "swap_at": 13},
            r"swap_at=13 must lie in 0 \.\.\. 12",
        ),
        (EDGERequest, {"foot_contact": "planted"}, "foot_contact='planted' must be True or False"),
        (LodgeRequest, {"relation": "echo"}, "relation='echo' is not one of 'unison'"),
        (LodgeRequest, {"soft": 2}, r"soft=2 must lie in 0 \.\.\. 1"),
        (LodgeRequest, {"at_once": 0}, "at_once=0 must be a number of at least 1"),
    ],
)
def test_bad_values_are_named(request_, options, message):
    with pytest.raises(ValueError, match=message):
        request_(**options).resolve(model(), Tune())


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"soft": 0.5}, "soft=0.5 is not for the model 'trio'; models of lodge have it"),
        ({"colour": "red"}, "colour='red' is no option; choose from preset, seconds"),
    ],
)
def test_options_of_others_and_of_nobody_are_named(options, message):
    with pytest.raises(ValueError, match=message):
        request_of("tcdiffpp", "trio", options)


def test_song_without_sound_or_length():
    with pytest.raises(ValueError, match="'tune' is silent"):
        TCDiffPPRequest().resolve(model(), Tune(is_silent=True))
    with pytest.raises(ValueError, match=r"song is 0\.20 s long; at least 1 s"):
        TCDiffPPRequest().resolve(model(), Tune(0.2))


def test_one_constraint_needs_no_list():
    path = WalkAlong(0, [(0, 0, 0)])
    alone, listed = (TCDiffPPRequest(constraints=given) for given in (path, [path]))
    assert alone.constraints == listed.constraints == (path,)
    with pytest.raises(ValueError, match="constraints has 'path'"):
        TCDiffPPRequest(constraints="path").resolve(model(), Tune())


def test_facts_are_plain():
    found = TCDiffPPRequest(dancers=np.int64(2), swap=np.array([1, 0]), start=[(0, 0), (1, 0)])
    facts = found.resolve(model(), Tune()).facts()
    assert facts["dancers"] == 2 and facts["swap"] == [1, 0] and type(facts["dancers"]) is int
    assert "start" not in facts and "device" not in facts
