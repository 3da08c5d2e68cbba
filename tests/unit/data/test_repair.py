import pytest
import roma
import torch

from dancediff.data.bvh import BVH
from dancediff.data.repair import bridge, repair, runs
from dancediff.motion.rotation import slerp

JOINTS = {"root": "hip", "belly": "belly", "head": "head", "lelbow": "arm"}
F, FPS = 240, 60.0


def about(axis, degrees):
    v = torch.zeros(len(degrees), 3).double()
    v[:, axis] = torch.deg2rad(degrees.double())
    return roma.rotvec_to_rotmat(v)


def dance(f=F):
    """Four joints that swing calmly, 60 frames a second."""
    at = torch.arange(f) / FPS
    R = torch.stack(
        [about(1, 20 * at), about(0, 10 * torch.sin(at)), about(1, 30 * torch.sin(2 * at)),
         about(2, 40 * torch.sin(3 * at))], 1,
    )  # fmt: skip
    offsets = torch.tensor([[0.0, 0, 0], [0, 0.2, 0], [0, 0.3, 0], [0.3, 0, 0]]).double()
    move = offsets.repeat(f, 1, 1)
    move[:, 0, 0] = 0.3 * at
    return BVH(("hip", "belly", "head", "arm"), (-1, 0, 1, 1), offsets, R, move, FPS)


def error(a, b):
    """Largest angle between two recordings' rotations, degrees, per joint."""
    return torch.rad2deg(roma.rotmat_geodesic_distance(a.rotations, b.rotations)).amax(0)


def test_a_good_dance_is_left_alone():
    repaired, done = repair(dance(), JOINTS)
    assert done == []
    assert torch.equal(repaired.rotations, dance().rotations)


def test_a_spike_of_a_limb_is_bridged_and_the_rest_untouched():
    broken = dance()
    broken.rotations[100:103, 3] = about(0, torch.tensor([50.0, 90, 50]))
    repaired, done = repair(broken, JOINTS)
    assert [(d["joint"], d["kind"]) for d in done] == [("arm", "spike")]
    assert 90 < done[0]["first"] < 98  # with a margin
    assert 104 < done[0]["last"] < 112
    assert error(repaired, dance())[3] < 2
    assert torch.equal(repaired.rotations[:, :3], broken.rotations[:, :3])
    assert torch.equal(repaired.rotations[:90], broken.rotations[:90])


def test_spikes_close_together_are_one():
    broken = dance()
    for frame in (100, 112):
        broken.rotations[frame, 3] = about(0, torch.tensor([90.0]))[0]
    assert len(repair(broken, JOINTS)[1]) == 1
    broken.rotations[150, 3] = about(0, torch.tensor([90.0]))[0]
    assert len(repair(broken, JOINTS)[1]) == 2


def test_how_a_joint_crept_away_goes_with_the_spike():
    broken = dance()
    broken.rotations[100:110, 1] = about(0, torch.linspace(12, 60, 10))
    (done,) = repair(broken, JOINTS)[1]
    assert done["first"] < 100
    assert error(repair(broken, JOINTS)[0], dance())[1] < 3


def test_thighs_are_left_to_the_retargeting():
    broken = dance()
    broken.rotations[100, 3] = about(0, torch.tensor([90.0]))[0]
    assert repair(broken, {"root": "hip", "lhip": "arm"})[1] == []


def test_a_pelvis_spike_takes_the_whole_body_and_the_path():
    broken = dance()
    broken.rotations[100, 0] = about(2, torch.tensor([80.0]))[0]
    broken.translations[100, 0] += 0.5
    repaired, done = repair(broken, JOINTS)
    assert [d["joint"] for d in done] == ["body"]
    assert error(repaired, dance()).max() < 2
    assert (repaired.root - dance().root).abs().max() < 0.005


def test_a_jump_of_the_path_alone_is_found():
    broken = dance()
    broken.translations[150, 0, 1] += 0.3
    repaired, done = repair(broken, JOINTS)
    assert [d["joint"] for d in done] == ["body"]
    assert (repaired.root - dance().root).abs().max() < 0.005


def under_a_reference(bvh):
    """The same recording with one more joint on top, which turns the axes and goes nowhere."""
    turn = about(0, torch.full((bvh.num_frames,), 90.0))[:, None]
    zero = torch.zeros(bvh.num_frames, 1, 3).double()
    return BVH(
        ("reference", *bvh.names),
        (-1, *(parent + 1 for parent in bvh.parents)),
        torch.cat([zero[0], bvh.offsets]),
        torch.cat([turn, bvh.rotations], 1),
        torch.cat([zero, bvh.translations], 1),
        bvh.fps,
    )


@pytest.mark.parametrize("joint", [0, 1])
def test_a_jump_of_the_path_is_found_below_a_joint_that_is_no_pelvis(joint):
    """The path was that of the file's first joint, and what was found there was not bridged."""
    broken = under_a_reference(dance())
    broken.translations[150, joint, 1] += 0.3
    repaired, done = repair(broken, JOINTS)
    assert [d["joint"] for d in done] == ["body"]
    path = under_a_reference(dance()).world()[0][:, 1]
    assert (repaired.world()[0][:, 1] - path).abs().max() < 0.005


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_head_on_backwards_is_turned_back(axis):
    broken = dance()
    half = about(axis, torch.tensor([180.0]))[0]
    broken.rotations[80:200, 2] = broken.rotations[80:200, 2] @ half
    repaired, done = repair(broken, JOINTS)
    flips = [d for d in done if d["kind"] == "flip"]
    assert flips == [{"joint": "head", "first": 80, "last": 199, "kind": "flip"}]
    assert error(repaired, dance()).max() < 2


def test_a_bad_end_holds_the_last_good_frame():
    broken = dance()
    broken.rotations[-2:, 3] = about(0, torch.tensor([100.0]))[0]
    repaired, _ = repair(broken, JOINTS)
    steps = roma.rotmat_geodesic_distance(repaired.rotations[1:, 3], repaired.rotations[:-1, 3])
    assert steps[-1] == 0
    assert torch.rad2deg(steps).max() < 3


def test_suspects_are_held_to_a_stricter_speed():
    broken = dance()
    broken.rotations[60:, 1] = broken.rotations[60:, 1] @ about(0, torch.tensor([8.0]))  # a step
    assert repair(broken, JOINTS)[1] == []
    short = repair(broken, JOINTS, suspect=[(59, 61)])[1]
    long = repair(broken, JOINTS, suspect=[(40, 120)])[1]
    assert [d["joint"] for d in short] == [d["joint"] for d in long] == ["body"]
    assert long[0]["last"] - long[0]["first"] < 12


@pytest.mark.parametrize("suspect", [(-3, -2), (-1, -1), (-60, -2)])
def test_what_is_known_of_frames_that_were_cut_off_changes_nothing(suspect):
    """Counted from the end, such a range was nearly the whole take."""
    repaired, done = repair(dance(), JOINTS, suspect=[suspect])
    assert done == [] and torch.equal(repaired.rotations, dance().rotations)


def test_everything_bad_is_left_as_it_is():
    mad = dance()
    mad.rotations[:] = roma.random_rotmat(F * 4).double().view(F, 4, 3, 3)
    repaired, _ = repair(mad, JOINTS)
    rest = [0, 1, 3]  # the head may be turned back
    assert torch.equal(repaired.rotations[:, rest], mad.rotations[:, rest])
    assert torch.equal(repaired.translations, mad.translations)
    assert torch.isfinite(repaired.rotations).all()


def test_slerp_goes_at_constant_speed():
    R0, R1 = about(1, torch.tensor([10.0])), about(1, torch.tensor([70.0]))
    torch.testing.assert_close(
        slerp(R0, R1, torch.tensor([0.25]).double()), about(1, torch.tensor([25.0]))
    )


def test_bridge_and_runs():
    bad = torch.tensor([True, False, True, True, False, True])
    assert runs(bad) == [(0, 0), (2, 3), (5, 5)]
    x = torch.tensor([9.0, 1, 9, 9, 4, 9]).double()
    assert bridge(x, bad).tolist() == [1, 1, 2, 3, 4, 4]
