from dataclasses import replace

import numpy as np
import pytest
import roma
import torch

from dancediff.data.bvh import read_bvh
from dancediff.data.choreographer import choreograph
from dancediff.data.retarget import (
    floor_height,
    leg_scale,
    measure,
    resample,
    retarget,
    skating_ratio,
)
from dancediff.export.bvh import save_bvh
from dancediff.motion.contact import TOE_CLEARANCE, foot_contact
from dancediff.motion.rotation import rotation_about
from dancediff.motion.skeleton import SMPL24

LIMBS = [("hip", "knee"), ("knee", "ankle"), ("ankle", "toe"), ("shoulder", "elbow")]
MIDDLE = ("root", "belly", "spine", "chest", "neck", "head")
MIXAMO = {
    ours: f"mixamorig:{theirs}"
    for ours, theirs in zip(MIDDLE, "Hips Spine Spine1 Spine2 Neck Head".split(), strict=True)
}
for _side, _word in (("l", "Left"), ("r", "Right")):
    for _ours, _theirs in {
        **{"hip": "UpLeg", "knee": "Leg", "ankle": "Foot", "toe": "ToeBase", "collar": "Shoulder"},
        **{"shoulder": "Arm", "elbow": "ForeArm", "wrist": "Hand", "hand": "HandMiddle1"},
    }.items():
        MIXAMO[_side + _ours] = f"mixamorig:{_word}{_theirs}"


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 6, 0.5), dancers=1, seed=4)[0]


@pytest.fixture
def recording(dance, tmp_path):
    return read_bvh(save_bvh(dance, tmp_path / "dance.bvh"))


def bone_angles(a, b):
    """Mean angle between the limbs of two motions, degrees."""
    errors = []
    for side in "lr":
        for upper, lower in LIMBS:
            i, k = SMPL24.index(side + upper), SMPL24.index(side + lower)
            u, v = (x[:, k] - x[:, i] for x in (a, b))
            errors.append(torch.nn.functional.cosine_similarity(u, v, dim=-1).clamp(-1, 1).acos())
    return torch.rad2deg(torch.stack(errors)).mean().item()


def test_our_own_skeleton_comes_back_as_it_is(dance, recording):
    motion, numbers = retarget(recording)
    ours, theirs = motion.joints()[0], dance.joints()[0][: motion.num_frames]
    shift = (ours - theirs).mean((0, 1))
    assert numbers["scale"] == pytest.approx(1, abs=1e-4)
    assert numbers["direction_error"] < 0.5
    assert shift[[0, 2]].abs().max() < 1e-3
    assert ((ours - theirs - shift).norm(dim=-1)).quantile(0.99) < 0.01
    angles = roma.rotmat_geodesic_distance(motion.pose[0], dance.pose[0, : motion.num_frames])
    assert torch.rad2deg(angles[:, :10]).quantile(0.95) < 3


def test_limbs_of_another_skeleton_keep_their_directions(dance, recording):
    """Mixamo names, other proportions, metres for centimetres, the body at rest faces backwards."""
    turn = rotation_about("y", torch.tensor(torch.pi)).double()
    stretch = torch.ones(len(recording.names), 1).double()
    for name in ("lknee", "rknee", "lelbow", "relbow", "spine"):
        stretch[recording.index(name)] = 1.25
    other = replace(
        recording,
        names=tuple(MIXAMO.get(name, name) for name in recording.names),
        offsets=(recording.offsets @ turn.T) * stretch,
        rotations=turn @ recording.rotations @ turn.T,
        translations=(recording.translations @ turn.T) * stretch,
    )
    motion, numbers = retarget(other, "mixamo")
    theirs = dance.joints()[0][: motion.num_frames] @ turn.T.float()
    assert bone_angles(motion.joints()[0], theirs) < 3
    assert numbers["direction_error"] < 3
    assert numbers["scale"] < 0.95


def test_turning_the_recording_turns_the_motion(recording):
    turn = rotation_about("y", torch.tensor(1.1)).double()
    rotations, move = recording.rotations.clone(), recording.translations.clone()
    rotations[:, 0], move[:, 0] = turn @ rotations[:, 0], move[:, 0] @ turn.T
    turned, _ = retarget(replace(recording, rotations=rotations, translations=move))
    straight, _ = retarget(recording)
    expected = straight.joints()[0] @ turn.T.float()
    torch.testing.assert_close(turned.joints()[0], expected, atol=1e-4, rtol=0)


def test_floor_is_found_wherever_the_recording_has_it(recording):
    high = recording.translations.clone()
    high[:, 0, 1] += 0.37
    a, n = retarget(replace(recording, translations=high))
    b, m = retarget(recording)
    assert n["floor"] - m["floor"] == pytest.approx(0.37, abs=1e-4)
    torch.testing.assert_close(a.root, b.root, atol=1e-4, rtol=0)
    assert -0.01 < n["lowest_median"] < 0.06
    assert n["penetration_p95"] < 0.03


def test_a_knee_on_the_wrong_side_is_turned_back_and_the_ankle_stays(recording):
    good, _ = retarget(recording)
    hip, ankle = recording.index("lhip"), recording.index("lankle")
    points, Q = recording.world()
    axis = torch.nn.functional.normalize(points[:, ankle] - points[:, hip], dim=-1)
    half = roma.rotvec_to_rotmat(torch.pi * axis)
    rotations = recording.rotations.clone()
    wrong = slice(60, 80)
    parent = Q[wrong, recording.parents[hip]]
    rotations[wrong, hip] = parent.mT @ half[wrong] @ Q[wrong, hip]
    flipped, numbers = retarget(replace(recording, rotations=rotations))
    assert [(d["joint"], d["kind"]) for d in numbers["repairs"]] == [("lknee", "knee")]
    off = (flipped.joints() - good.joints())[0].norm(dim=-1)
    assert off[:, SMPL24.index("lankle")].max() < 0.01
    assert off[:, SMPL24.index("ltoe")].max() < 0.03
    assert off[:, SMPL24.index("lknee")].max() < 0.1


def test_contacts_are_those_of_the_new_body(recording):
    motion, _ = retarget(recording)
    assert torch.equal(motion.contact, foot_contact(motion.joints()))
    assert 0.1 < motion.contact.mean() < 1


def test_feet_do_not_sink(recording):
    sinking, low = recording.rotations.clone(), recording.translations.clone()
    down = roma.rotvec_to_rotmat(torch.tensor([0.5, 0, 0]).double())
    for name in ("lankle", "rankle"):
        foot = recording.index(name)
        sinking[40:50, foot] = sinking[40:50, foot] @ down
    low[40:50, 0, 1] -= 0.1
    motion, _ = retarget(replace(recording, rotations=sinking, translations=low))
    height = motion.joints()[0, ..., 1]
    assert height[:, (10, 11)].min() > 0.009
    assert height[:, (7, 8)].min() > 0.049
    toes = motion.pose[0, :, (10, 11)]
    torch.testing.assert_close(toes, torch.eye(3).expand_as(toes), atol=1e-5, rtol=0)


def test_the_rest_pose_makes_no_difference(recording):
    """Arms that hang at rest and legs that stand apart, turned back by the rotations."""
    angled, offsets = recording.rotations.clone(), recording.offsets.clone()
    for name, turn in (("lshoulder", -1.0), ("rshoulder", 1.0), ("lhip", 0.2), ("neck", 0.4)):
        A = rotation_about("z", torch.tensor(turn)).double()
        joint = recording.index(name)
        angled[:, joint] = angled[:, joint] @ A.T
        for child in (k for k, p in enumerate(recording.parents) if p == joint):
            offsets[child] = A @ offsets[child]
            angled[:, child] = A @ angled[:, child]
    move = recording.translations.clone()
    move[:, 1:] = offsets[1:]
    same, _ = retarget(replace(recording, offsets=offsets, rotations=angled, translations=move))
    plain, _ = retarget(recording)
    off = (same.joints() - plain.joints())[0].norm(dim=-1).amax(0)
    assert off[[18, 20, 4, 7, 15]].max() < 0.01  # elbow, wrist, knee, ankle, head


def test_one_frame_is_enough(recording):
    motion, numbers = retarget(recording.frames(3, 4))
    assert motion.num_frames == 1
    assert numbers["direction_error"] < 0.5


@pytest.mark.parametrize("scale", [0, -1, float("nan")])
def test_refuses_a_scale_without_sense(recording, scale):
    with pytest.raises(ValueError, match="scale="):
        retarget(recording, scale=scale)


def test_missing_joints_are_named(recording):
    names = tuple(name.replace("relbow", "x") for name in recording.names)
    with pytest.raises(ValueError, match="relbow"):
        retarget(replace(recording, names=names))


def test_a_body_without_legs_is_refused(recording):
    flat = replace(recording, offsets=torch.zeros_like(recording.offsets))
    with pytest.raises(ValueError, match="no length"):
        leg_scale(flat, {name: name for name in SMPL24.names})


@pytest.mark.parametrize(("rate", "frames"), [(120.0, 241), (60.0, 121), (25.0, 51), (30.0, 61)])
def test_resampling_keeps_a_steady_turn_steady(recording, rate, frames):
    at = torch.arange(frames).double() / rate
    v = torch.zeros(frames, 3).double()
    v[:, 1] = at
    R = torch.eye(3).double().repeat(frames, len(recording.names), 1, 1)
    R[:, 0] = roma.rotvec_to_rotmat(v)
    move = recording.offsets.repeat(frames, 1, 1)
    move[:, 0, 0] = 2 * at
    out = resample(replace(recording, rotations=R, translations=move, fps=rate), 30.0)
    now = torch.arange(out.num_frames).double() / 30
    assert out.num_frames == int((frames - 1) / rate * 30 + 1e-6) + 1
    assert out.fps == 30
    torch.testing.assert_close(roma.rotmat_to_rotvec(out.rotations[:, 0])[:, 1], now)
    torch.testing.assert_close(out.root[:, 0], 2 * now)


def test_skating_ratio_counts_feet_that_slide_while_down():
    feet = torch.zeros(11, 4, 3)
    assert skating_ratio(feet) == 0
    feet[:, (0, 2), 0] = 0.02 * torch.arange(11.0)[:, None]  # the left foot slides
    assert skating_ratio(feet) == 0.5
    feet[:, 2, 1] = 0.2  # and is in the air
    assert skating_ratio(feet) == 0
    feet[..., 1] = 1
    assert skating_ratio(feet) == 0


def test_floor_follows_standing_feet():
    feet = torch.zeros(100, 4, 3)
    feet[:, :, 1] = 0.12
    feet[:15, 2, 1] = -0.3  # sinks while it moves
    feet[30:, :, 1] = 0.5  # a long leap
    feet[:, :, 0] = torch.arange(100.0)[:, None]
    feet[15:30, :, 0] = 0
    assert floor_height(feet) == pytest.approx(0.10, abs=1e-6)


def test_measure_sees_a_wrong_limb_and_a_sunken_body(dance):
    points = dict(zip(SMPL24.names, dance.joints()[0].double().unbind(1), strict=True))
    assert measure(dance, points)["direction_error"] < 0.1
    points["lwrist"] = points["lelbow"] + torch.tensor([0.0, 0, 1]).double()
    assert measure(dance, points)["bone_errors"]["lelbow-lwrist"] > 10
    sunk = replace(dance, root=dance.root - torch.tensor([0, 0.1, 0]))
    assert measure(sunk, points)["penetration_p95"] > 0.05


def test_the_floor_is_found_at_any_frame_rate():
    """A toe that glides at 0.3 m/s does not stand, however many frames a second there are."""
    for fps in (30, 120):
        feet = torch.zeros(2 * fps, 4, 3)
        feet[fps:, :, 1] = 1.0  # half of the time it glides, a metre higher
        feet[fps:, :, 0] = torch.arange(fps)[:, None] * 0.3 / fps
        feet[: fps // 2, :, 0] += torch.arange(fps // 2)[:, None] * 10.0
        assert abs(floor_height(feet, fps) + TOE_CLEARANCE) < 1e-6
