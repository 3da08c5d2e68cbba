"""Foot contact: which guesses of a sampler get planted feet, and what stays as it was asked for."""

import torch

import dancediff as dd
from dancediff.extensions.floor_contact import stand_on_floor
from dancediff.extensions.foot_contact_projection import LEGS, foot_contact_hook, plant_feet
from dancediff.extensions.projection import Fixed
from dancediff.extensions.speed_limit import limit_travel, limit_turns
from dancediff.motion.representation import TCDIFFPP, Normalizer

KNEE = TCDIFFPP.joint_channels([dd.motion.skeleton.SMPL24.index("lknee")])


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
