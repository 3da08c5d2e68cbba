"""Joint positions become a dance whose joints are there, and whose limbs bend as limbs do."""

import numpy as np
import pytest
import torch

from dancediff.data.bvh import read_bvh
from dancediff.data.choreographer import choreograph
from dancediff.data.retarget import retarget
from dancediff.motion.from_joints import fit_rotations
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24, forward_kinematics


def degrees_apart(a, b):
    trace = (a.mT @ b).diagonal(dim1=-2, dim2=-1).sum(-1)
    return ((trace - 1) / 2).clamp(-1, 1).acos().rad2deg()


def in_the_world(pose):
    Q = []
    for j, parent in enumerate(SMPL24.parents):
        Q.append(pose[:, :, j] if parent < 0 else Q[parent] @ pose[:, :, j])
    return torch.stack(Q, 2)


@pytest.fixture(scope="module")
def salsa(real_data):
    return retarget(read_bvh(real_data / "cmu" / "salsa" / "06.bvh", fps=60), "cmu")[0]


def test_joints_of_a_real_dance_are_within_a_centimetre(salsa):
    again = Motion.from_joints(salsa.joints(), salsa.fps)
    off = (again.joints() - salsa.joints()).norm(dim=-1)
    assert off.max() < 1e-4  # a tenth of a millimetre; the bar is a centimetre
    assert again.fps == salsa.fps and again.num_frames == salsa.num_frames


def test_thighs_are_turned_as_they_were_and_nothing_jumps(salsa):
    pose, _ = fit_rotations(salsa.joints())
    at = [SMPL24.index(name) for name in ("root", "lhip", "rhip")]
    apart = degrees_apart(in_the_world(pose)[:, :, at], in_the_world(salsa.pose)[:, :, at])
    assert apart.max() < 2  # degrees: the knee's hinge tells it
    step = degrees_apart(pose[:, 1:], pose[:, :-1]).max()
    assert step < degrees_apart(salsa.pose[:, 1:], salsa.pose[:, :-1]).max() + 2


def test_noise_of_a_centimetre_stays_one(salsa):
    noise = torch.Generator().manual_seed(0)
    points = salsa.joints()
    noisy = points + 0.01 * torch.randn(points.shape, generator=noise) / 3**0.5
    off = (Motion.from_joints(noisy).joints() - points).norm(dim=-1)
    assert off.mean() < 0.02


def test_a_group_with_longer_legs_keeps_its_bones_and_its_floor():
    dance, _ = choreograph(np.arange(0.3, 4, 0.5), dancers=3, seed=2, seconds=4)
    points = dance.joints()
    fitted = Motion.from_joints(1.2 * points).joints()
    assert torch.allclose(fitted, points, atol=1e-4)  # one scale for places, too


def test_bones_that_point_backward_are_half_turns():
    pose = torch.eye(3).repeat(1, 2, 24, 1, 1)
    pose[0, 1, SMPL24.index("lelbow")] = torch.diag(torch.tensor([-1.0, -1.0, 1.0]))
    pose[0, 1, SMPL24.index("head")] = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    points = forward_kinematics(pose, torch.zeros(1, 2, 3))
    upper = points[0, 1, SMPL24.index("relbow")] - points[0, 1, SMPL24.index("rshoulder")]
    points[0, 1, SMPL24.index("relbow")] -= 2 * upper  # a bone against its rest direction
    for name in ("rwrist", "rhand"):
        points[0, 1, SMPL24.index(name)] -= 2 * upper
    found, root = fit_rotations(points)
    assert (forward_kinematics(found, root) - points).norm(dim=-1).max() < 1e-4
    assert torch.allclose(found @ found.mT, torch.eye(3).expand_as(found), atol=1e-5)
    assert (torch.linalg.det(found) > 0.99).all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda x: x[0], r"points has shape \(2, 24, 3\); expected \(n, f, 24, 3\)"),
        (lambda x: x[:, :, :22], r"\(1, 2, 22, 3\)"),
        (lambda x: x * torch.nan, "not finite"),
        (lambda x: torch.cat([x, 0 * x], dim=1), "dancer 0, frame 2: .* in one place"),
    ],
)
def test_wrong_points_say_what_is_wrong(change, words):
    rest = forward_kinematics(torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3))
    with pytest.raises(ValueError, match=words):
        Motion.from_joints(change(rest))
