"""Foot contact projection: feet stand, and nothing else moves; which guesses it changes."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.extensions.floor_contact import flights, project_floor_contact
from dancediff.extensions.foot_contact_projection import (
    LEGS,
    LOWEST,
    SMOOTH,
    STAND,
    foot_contact_hook,
    foot_contact_shift,
    legs_apart,
    project_foot_contact,
    support,
)
from dancediff.extensions.projection import Fixed
from dancediff.extensions.speed_limit import limit_travel, limit_turns
from dancediff.metrics.physical import fsr
from dancediff.metrics.posture import ankles_close, knee_bend, legs_crossed
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.representation import LODGE, TCDIFFPP, Normalizer, joints_of, pack, unpack
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_rot6d
from dancediff.motion.skeleton import FOOT_JOINTS, SMPL24, world_rotations

LEG_JOINTS = [SMPL24.index(side + part) for side in "lr" for part in ("hip", "knee", "ankle")]

KNEE = TCDIFFPP.joint_channels([SMPL24.index("lknee")])


@pytest.fixture(scope="module")
def dance():
    """Two dancers who step, (2, 150, 151)."""
    return choreograph(np.arange(0.3, 5.5, 0.5), dancers=2, seed=4, seconds=5)[0].features()


@pytest.fixture(scope="module")
def sliding(dance):
    """The same with a root that wanders 6 cm to and fro: every foot slides."""
    x = dance.clone()
    wave = torch.sin(torch.linspace(0, 40, dance.shape[1]))
    x[..., 4] += 0.06 * wave
    return x


def test_the_shift_minimises_its_equation():
    """The closed form against a general least-squares solver."""
    g = torch.Generator().manual_seed(0)
    p, c = torch.randn(12, 2, 3, generator=g) + 5, torch.rand(12, 2, generator=g)
    f = len(p)
    D = torch.eye(f, dtype=torch.float64).diff(dim=0)
    rows, right = [torch.eye(f, dtype=torch.float64)], [torch.zeros(f, 3, dtype=torch.float64)]
    rows.append(SMOOTH**0.5 * D.diff(dim=0))
    right.append(torch.zeros(f - 2, 3, dtype=torch.float64))
    for j in range(2):
        sure = ((c[:-1, j].double() - 0.3) / 0.4).clamp(0, 1)
        weight = (STAND * sure).sqrt()[:, None]
        rows.append(weight * D)
        right.append(-weight * p[:, j].double().diff(dim=0))
    u = foot_contact_shift(p, c).double()
    wanted = torch.linalg.lstsq(torch.cat(rows), torch.cat(right)).solution
    assert torch.allclose(u[:, ::2], wanted[:, ::2], atol=1e-5)
    toe = (STAND * ((c[:, 1].double() - 0.3) / 0.4).clamp(0, 1)).sqrt()[:, None]
    rows.append(toe * torch.eye(f))
    right.append(toe * (TOE_CLEARANCE - p[:, 1].double()))
    up = torch.linalg.lstsq(torch.cat(rows), torch.cat(right)).solution[:, 1:2]
    lift = (torch.tensor(LOWEST) - p[..., 1] - up).amax(-1).clamp_min(0)
    assert torch.allclose(u[:, 1], up[:, 0] + lift, atol=1e-5)


def test_sliding_feet_come_to_stand(dance, sliding):
    """Of feet that all slide hardly one still does."""
    before, after = fsr(joints_of(sliding)), fsr(joints_of(project_foot_contact(sliding)))
    assert before > 0.5
    assert after < fsr(joints_of(dance)) + 0.03


def test_no_foot_waits_and_then_jumps(dance):
    """A little contact all along the way, but in a single frame, must not gather it all there."""
    x = dance.clone()
    x[..., TCDIFFPP.contact] = x[..., TCDIFFPP.contact].clamp_min(0.05)
    x[:, ::10, TCDIFFPP.contact] = x[:, ::10, TCDIFFPP.contact].floor()

    def fastest(features):
        return joints_of(features)[:, :, FOOT_JOINTS].diff(dim=1).norm(dim=-1).max()

    assert fastest(project_foot_contact(x)) < 1.2 * fastest(x)


def test_only_legs_and_the_place_of_the_root_change(sliding):
    """Contacts, back and arms are the same bits; so are the toes on their feet."""
    changed = {
        *TCDIFFPP.joint_channels(LEG_JOINTS),
        *range(TCDIFFPP.root.start, TCDIFFPP.root.stop),
    }
    others = [c for c in range(TCDIFFPP.dim) if c not in changed]
    planted = project_foot_contact(sliding)
    assert torch.equal(planted[..., others], sliding[..., others])
    assert not torch.equal(planted, sliding)


def test_the_root_stays_where_it_is_asked_to(sliding):
    rooted = torch.zeros(*sliding.shape[:-1], 3, dtype=torch.bool)
    rooted[..., 5:20, 1] = True  # its height, for half a second
    moved = (project_foot_contact(sliding, rooted=rooted) - sliding)[..., TCDIFFPP.root]
    assert (moved[rooted] == 0).all() and (moved[..., (0, 2)] != 0).any()
    rooted[:] = True
    assert torch.equal(
        project_foot_contact(sliding, rooted=rooted)[..., TCDIFFPP.root],
        sliding[..., TCDIFFPP.root],
    )


def test_knees_keep_their_bend_when_a_body_is_too_high(dance):
    """Feet come down to the floor, and the root with them; legs alone would have to straighten."""
    high = dance.clone()
    high[..., TCDIFFPP.root.start + 1] += 0.05
    fixed = torch.ones(*high.shape[:-1], 3, dtype=torch.bool)
    before = knee_bend(joints_of(high))
    assert abs(knee_bend(joints_of(project_foot_contact(high))) - before) < 2
    assert knee_bend(joints_of(project_foot_contact(high, rooted=fixed))) < before - 8


def test_legs_that_close_or_cross_are_parted(dance):
    x = dance.clone()
    hips = TCDIFFPP.joint_channels([1, 2])
    turned = unpack(x)[2][..., [1, 2], :, :]
    inwards = axis_angle_to_matrix(torch.tensor([[0.0, 0.0, -0.15], [0.0, 0.0, 0.15]]))
    x[..., hips] = matrix_to_rot6d(inwards @ turned).flatten(-2)
    before, after = (
        (ankles_close(joints), legs_crossed(joints))
        for joints in (joints_of(x), joints_of(project_foot_contact(x)))
    )
    assert sum(before) > 0.2 and sum(after) < sum(before) / 2, (before, after)
    apart = legs_apart(joints_of(dance))  # what the choreographer makes is hardly touched
    assert (apart.abs().amax(-1) > 0.005).float().mean() < 0.1


def test_lodges_vector_is_projected_like_the_other(sliding):
    """Without hands, the same legs."""
    planted = project_foot_contact(sliding[..., : LODGE.dim], spec=LODGE)
    assert torch.equal(planted, project_foot_contact(sliding)[..., : LODGE.dim])


def test_feet_keep_their_direction(sliding):
    """The ankle's rotation in the world is what it was."""
    ankles = [SMPL24.index("lankle"), SMPL24.index("rankle")]
    before = world_rotations(unpack(sliding)[2])[..., ankles, :, :]
    after = world_rotations(unpack(project_foot_contact(sliding))[2])[..., ankles, :, :]
    assert torch.allclose(before, after, atol=1e-4)


def test_a_dance_whose_feet_stand_stays_as_it_is(dance):
    """Little to do: no joint moves by more than three centimetres, most by under a millimetre."""
    moved = (joints_of(project_foot_contact(dance)) - joints_of(dance)).norm(dim=-1)
    assert moved.max() < 0.03
    assert moved.median() < 0.001


def both_travel(x):
    """Share of frames on the floor in which both toes go more than a centimetre."""
    joints = joints_of(x)
    step = joints[..., FOOT_JOINTS[2:], :][..., (0, 2)].diff(dim=1).norm(dim=-1)
    on_floor = joints[:, 1:, :, 1].amin(-1) < TOE_CLEARANCE + 0.02
    return ((step > 0.01).all(-1) & on_floor).sum() / on_floor.sum()


def test_somebody_stands_even_if_no_contact_says_so(dance, sliding):
    """Without any contact both feet would slide with the root; one does not."""
    free = sliding.clone()
    free[..., TCDIFFPP.contact] = 0
    assert both_travel(dance) < 0.02
    assert both_travel(free) > 0.5
    assert both_travel(project_foot_contact(free)) < 0.1


def test_support_only_adds_contacts_where_there_are_none(dance):
    """Where a toe is planted, and in the air, contacts stay; elsewhere one toe stands."""
    contact, joints = dance[..., TCDIFFPP.contact], joints_of(dance)
    assert torch.equal(support(contact, joints), contact)
    none = torch.zeros_like(contact)
    stands = support(none, joints)
    assert (stands[..., :2] == 0).all() and ((stands > 0).sum(-1) <= 1).all()
    leaps = flights(joints[..., 1].amin(-1) - TOE_CLEARANCE)
    assert leaps.any() and (stands[leaps] == 0).all()
    assert (stands > 0).any(-1)[~leaps].float().mean() > 0.95


def test_a_leap_is_not_supported(sliding):
    """Nine frames up and down again."""
    high = sliding.clone()
    high[:, 60:69, TCDIFFPP.root.start + 1] += 0.12 * torch.sin(torch.linspace(0.3, 2.8, 9))
    none = torch.zeros_like(high[..., TCDIFFPP.contact])
    assert (support(none, joints_of(high))[:, 61:68] == 0).all()


def test_fixed_frames_stay_and_the_next_goes_on_from_there(sliding):
    """Legs that are known are the same bits; the foot does not jump beside them."""
    fixed = torch.zeros(2, 150, dtype=torch.bool)
    fixed[:, :60] = True
    planted = project_foot_contact(sliding, fixed)
    assert torch.equal(planted[:, :60], sliding[:, :60])
    feet = joints_of(planted)[:, :, FOOT_JOINTS]
    own = joints_of(sliding)[:, :, FOOT_JOINTS]
    jump = (feet[:, 60] - feet[:, 59]).norm(dim=-1)
    assert (jump < (own[:, 60] - own[:, 59]).norm(dim=-1) + 0.01).all()


def test_feet_under_the_floor_are_lifted(dance):
    """A body that sank 10 cm stands on the floor again, on bent knees."""
    low = dance.clone()
    low[..., 5] -= 0.1
    lowest = joints_of(project_foot_contact(low))[:, :, FOOT_JOINTS, 1].amin()
    assert joints_of(low)[:, :, FOOT_JOINTS, 1].amin() < -0.05
    assert lowest > min(LOWEST) - 0.01


def test_feet_that_hover_come_down(dance):
    """A body 3 cm too high puts the feet it stands on down to the floor, on straighter knees."""
    high = dance.clone()
    high[..., 5] += 0.03
    stands = dance[..., TCDIFFPP.contact][..., 2:] > 0.7
    before, after = (
        joints_of(x)[..., FOOT_JOINTS[2:], 1][stands] for x in (high, project_foot_contact(high))
    )
    assert before.median() > 0.045
    assert after.median() < 0.025


def test_a_foot_out_of_reach_slides_along():
    """A root that leaves at 3 m/s drags its feet; nothing breaks, no leg gets longer."""
    root = torch.zeros(60, 3)
    root[:, 0], root[:, 1] = torch.linspace(0, 6, 60), 0.93
    x = pack(torch.ones(60, 4), root, torch.eye(3).expand(60, 24, 3, 3))
    joints = joints_of(project_foot_contact(x))
    assert joints.isfinite().all()
    shin = (joints[:, 7] - joints[:, 4]).norm(dim=-1)
    assert torch.allclose(shin, SMPL24.offsets[7].norm().expand(60), atol=1e-4)


def test_gradients_are_finite(sliding):
    """Also where a leg is straight, as in the rest pose."""
    x = torch.cat([sliding[:1, :20], sliding[:1, :20]])
    rest = torch.eye(3)[:2].flatten().repeat(24)
    x[1, :, TCDIFFPP.rot6d] = rest
    x.requires_grad_()
    project_foot_contact(x).square().sum().backward()
    assert x.grad.isfinite().all()


def test_guesses_that_are_mostly_noise_stay():
    norm = Normalizer(-2 * torch.ones(151), torch.ones(151))
    x = torch.randn(1, 2, 20, 151, generator=torch.Generator().manual_seed(0))
    assert torch.equal(foot_contact_hook(norm).apply(x, abar=0.49), x)
    calm = limit_travel(limit_turns(norm.unnormalize(x)))
    wanted = norm.normalize(project_foot_contact(project_floor_contact(calm)))
    assert torch.equal(foot_contact_hook(norm).apply(x, abar=0.5), wanted)


def test_legs_are_fixed_where_any_of_their_rotations_is_known():
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
