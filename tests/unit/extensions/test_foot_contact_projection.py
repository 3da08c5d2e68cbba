"""Foot contact: which guesses of a sampler get planted feet, and what stays as it was asked for."""

import pytest
import torch

import dancediff as dd
from dancediff.extensions.control import Keep
from dancediff.extensions.floor_contact import stand_on_floor
from dancediff.extensions.foot_contact_projection import LEGS, foot_contact_hook, plant_feet
from dancediff.extensions.projection import Fixed
from dancediff.extensions.speed_limit import limit_travel, limit_turns
from dancediff.metrics.physical import fsr
from dancediff.motion.representation import TCDIFFPP, Normalizer
from dancediff.motion.skeleton import FOOT_JOINTS

KNEE = TCDIFFPP.joint_channels([dd.motion.skeleton.SMPL24.index("lknee")])


@pytest.fixture(scope="module")
def dance_with():
    model, song = dd.load("tcdiffpp"), dd.packaged_song()
    return lambda **more: model.generate(
        song, **{"dancers": 2, "seconds": 5, "steps": 8, "seed": 3} | more
    )


def test_guesses_that_are_mostly_noise_stay():
    norm = Normalizer(-2 * torch.ones(151), torch.ones(151))
    x = torch.randn(1, 2, 20, 151, generator=torch.Generator().manual_seed(0))
    assert torch.equal(foot_contact_hook(norm).apply(x, abar=0.49), x)
    calm = limit_travel(limit_turns(norm.unnormalize(x)))
    wanted = norm.normalize(plant_feet(stand_on_floor(calm)))
    assert torch.equal(foot_contact_hook(norm).apply(x, abar=0.5), wanted)


def test_legs_are_held_where_any_of_their_rotations_is_known():
    mask = torch.zeros(2, 6, 151, dtype=torch.bool)
    mask[0, 4, KNEE] = True
    mask[1, 3, TCDIFFPP.root] = True  # a place alone does not hold a leg
    mask[1, 5, [TCDIFFPP.root.start, TCDIFFPP.root.start + 2]] = True  # a path leaves the height
    fixed = Fixed(mask)
    legs = fixed.frames(TCDIFFPP.joint_channels(LEGS))
    assert legs.int().tolist() == [[0, 0, 0, 0, 1, 0], [0, 0, 0, 0, 0, 0]]
    assert torch.equal(fixed.frames(TCDIFFPP.rot6d), legs)
    assert fixed.height.int().tolist() == [[0, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 0]]
    assert fixed.place.int().tolist() == [[0, 0, 0, 0, 0, 0], [0, 0, 0, 1, 0, 1]]
    assert Fixed().height is None


def test_dances_slide_less_with_planted_feet(dance_with):
    free, planted = (dance_with(foot_contact=on) for on in (False, True))
    assert planted.meta["foot_contact"] and not free.meta["foot_contact"]
    assert fsr(planted.joints()) < 0.6 * fsr(free.joints())


def test_it_is_no_work_on_the_finished_dance(dance_with):
    """The network answers to planted feet: planting the free dance is not the same."""
    free, planted = (dance_with(foot_contact=on) for on in (False, True))
    afterwards = plant_feet(free.features())
    assert (afterwards[..., TCDIFFPP.root] - planted.root).abs().max() > 0.005


def test_legs_that_were_asked_for_are_kept(dance_with):
    other = dance_with(seed=9)
    kept = dance_with(constraints=[Keep(other, joints="lower body")])
    assert (kept.features()[..., KNEE] - other.features()[..., KNEE]).abs().max() < 1e-3


def test_planted_feet_do_not_move_at_a_seam():
    """Known frames are held, so that a long dance takes over where the segment before ended."""
    dance = dd.load("tcdiffpp").generate(dd.packaged_song(), dancers=2, seconds=10, steps=8, seed=1)
    step = 100 * dance.joints()[:, :, FOOT_JOINTS].diff(dim=1).norm(dim=-1)
    stands = dance.features()[:, :-1, TCDIFFPP.contact] > 0.5
    seams = [seam - 1 for seam in dance.meta["seams"] if seam < dance.num_frames]
    assert seams and stands[:, seams].any()
    jump = (step * stands)[:, seams]
    assert jump.max() < 1.5


def test_it_is_on_or_off(dance_with):
    with pytest.raises(ValueError, match="foot_contact='glued' must be True or False"):
        dance_with(foot_contact="glued")
