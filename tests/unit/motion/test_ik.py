import torch

from dancediff.motion.ik import two_bone_ik
from dancediff.motion.skeleton import SMPL24

THIGH, SHIN = SMPL24.offsets[4], SMPL24.offsets[7]


def targets(count=200):
    generator = torch.Generator().manual_seed(0)
    hip = torch.randn(count, 3, generator=generator)
    away = torch.nn.functional.normalize(torch.randn(count, 3, generator=generator), dim=-1)
    length = 0.3 + 0.5 * torch.rand(count, 1, generator=generator)
    pole = torch.randn(count, 3, generator=generator)
    return hip, hip + away * length, pole


def test_the_ankle_reaches_the_target():
    hip, target, pole = targets()
    thigh, shin, reached = two_bone_ik(hip, target, pole, THIGH, SHIN)
    ankle = hip + thigh @ THIGH + shin @ SHIN
    assert torch.allclose(ankle, target, atol=1e-4) and torch.allclose(reached, target, atol=1e-5)
    for R in (thigh, shin):
        assert torch.allclose(R @ R.mT, torch.eye(3).expand_as(R), atol=1e-4)
        assert (torch.linalg.det(R) > 0.99).all()


def test_the_knee_points_to_the_pole():
    hip, target, pole = targets()
    thigh, _, _ = two_bone_ik(hip, target, pole, THIGH, SHIN)
    knee = thigh @ THIGH
    line = torch.nn.functional.normalize(target - hip, dim=-1)
    aside = knee - (knee * line).sum(-1, keepdim=True) * line
    assert ((aside * pole).sum(-1) > -1e-5).all()


def test_out_of_reach_is_pulled_in():
    hip = torch.tensor([0.0, 1.0, 0.0])
    *_, reached = two_bone_ik(
        hip, torch.tensor([0.0, -3.0, 0.0]), torch.tensor([0.0, 0, 1]), THIGH, SHIN
    )
    leg = THIGH.norm() + SHIN.norm()
    assert torch.isclose((hip - reached).norm(), 0.999 * leg)
