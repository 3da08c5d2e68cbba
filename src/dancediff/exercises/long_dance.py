"""Exercises of lessons 11 and 12: the parts of Lodge."""

import torch

from dancediff.diffusion.samplers import sampling_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.exercises.exercise import Exercise
from dancediff.lodge.guidance import guided_steps
from dancediff.lodge.losses import l_critic
from dancediff.motion.rotation import rot6d_to_matrix


def _valleys(v):
    below = (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])
    return 1 + below.nonzero()[:, 0]


def _curves() -> list[tuple]:
    plateau = torch.tensor([3.0, 1.0, 1.0, 1.0, 2.0, 0.5, 2.0, 1.0])  # ends while it falls
    wave = torch.cos(torch.arange(90) / 7.0) + 0.3 * torch.cos(torch.arange(90) / 2.3)
    return [(plateau,), (wave,)]


def _forget(root):
    return root - root[:, :1] * root.new_tensor([1.0, 0.0, 1.0])


def _roots() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    return [(torch.randn(p, 8, 3, generator=draw).cumsum(1),) for p in (13, 2)]


def _mirror(R, swap):
    D = torch.diag(R.new_tensor([-1.0, 1.0, 1.0]))
    return D @ R[:, swap] @ D


def _poses() -> list[tuple]:
    R = rot6d_to_matrix(torch.randn(4, 5, 6, generator=torch.Generator().manual_seed(0)))
    return [(R, torch.tensor([0, 2, 1, 3, 4])), (R[:, :3], torch.tensor([2, 1, 0]))]


def _ways() -> list[tuple]:
    ways = [[999, 749, 499, 249, -1]]
    ways += [list(sampling_times(s, n, cosine_abar())) for s, n in (("ddim", 50), ("dpm", 20))]
    return [(way, s) for way in ways for s in (0.0, 0.3, 0.5, 1.0)]


def _verdicts() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sure = torch.tensor([1.5, 3.0]), torch.tensor([-1.0, -2.0])
    return [(2 * torch.randn(6, generator=draw), 2 * torch.randn(6, generator=draw)), sure]


EXERCISES = {
    "11.1": Exercise(
        "find the valleys",
        _valleys,
        "compare the inner frames v[1:-1] with v[:-2] (higher) and v[2:] (as high or higher); the "
        "first inner frame is frame 1",
        _curves,
    ),
    "11.2": Exercise(
        "forget the place",
        _forget,
        "take from every frame of a primitive where its own first frame stands, x and z only",
        _roots,
    ),
    "12.1": Exercise(
        "in the mirror",
        _mirror,
        "each joint takes its partner's rotation, R[:, swap], seen from the other side, D R D: "
        "signs change where a row or a column of x meets one of y or z",
        _poses,
    ),
    "12.2": Exercise(
        "the dead knob",
        guided_steps,
        "count the starts of steps, times[:-2] without the last one, above T (1 - s), with T = "
        "times[0] + 1 and t + 1 for t",
        _ways,
    ),
    "12.3": Exercise(
        "the critic's loss",
        l_critic,
        "what is missing to 1 for real dances, what is above -1 for made ones, never below 0; "
        "half of each mean",
        _verdicts,
    ),
}
