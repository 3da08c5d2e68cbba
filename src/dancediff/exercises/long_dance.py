"""Exercises of lessons 11 and 12: the parts of Lodge."""

import numpy as np
import torch

from dancediff.diffusion.samplers import sampling_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.exercises.exercise import Exercise
from dancediff.lodge.guidance import guided_steps
from dancediff.lodge.losses import l_critic
from dancediff.lodge.primitives import Layout, primitive_frames
from dancediff.motion.beats import mean_speed
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


def _wave(frames):
    when = torch.arange(frames)[:, None] / 30 + torch.arange(24) / 24
    return torch.stack([0.2 * torch.sin(torch.pi * when), 0 * when, 0 * when], -1)


def _no_numbers(got, shape: tuple) -> str:
    """What is wrong with an answer before anybody looks at its numbers, or ""."""
    if not isinstance(got, torch.Tensor | np.ndarray):
        return f"type {type(got).__name__}, expected a tensor {shape}"
    if tuple(got.shape) != shape:
        return f"shape {tuple(got.shape)}, expected {shape}"
    return "" if torch.as_tensor(got).isfinite().all() else "some of your numbers are not finite"


def _hides_its_rests(got, frames) -> str:
    if wrong := _no_numbers(got, (frames, 24, 3)):
        return wrong
    joints = torch.as_tensor(got).double()
    speed = 30 * np.linalg.norm(np.gradient(joints.numpy(), axis=0), axis=-1)  # (f, 24)
    slow = int(speed.mean(0).argmin())
    if speed.mean(0)[slow] < 0.1:
        return f"joint {slow} moves at {speed.mean(0)[slow]:.2f} m/s on average, expected 0.1"
    least = speed.reshape(-1, 30, 24).min(1).max(0) / speed.mean(0)
    if not least.max() <= 0.25:
        return f"joint {int(least.argmax())} has a second in which it does not come to rest"
    whole = mean_speed(joints)
    if not whole.min() >= 0.9 * whole.mean():
        share = whole.min() / whole.mean()
        return f"the mean joint speed falls to {share:.0%} of its mean, expected 90 % or more"
    return ""


def _hard_frames(N, n):
    return primitive_frames([], Layout(N, n))[::3]


def _at_borders(got, N, n) -> str:
    frames, want = torch.as_tensor(got), _hard_frames(N, n)
    if frames.shape != want.shape:
        return f"shape {tuple(frames.shape)}, expected {tuple(want.shape)} for N={N}, n={n}"
    for k, (row, right) in enumerate(zip(frames.tolist(), want.tolist(), strict=True)):
        if row != right:
            return (
                f"primitive {k} has frames {row[0]} ... {row[-1]}, "
                f"expected {right[0]} ... {right[-1]} for N={N}, n={n}"
            )
    return ""


def _walks() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    wander = torch.randn(3, 64, generator=draw).cumsum(1).cumsum(1) / 6000
    turn_back = torch.tensor([[0.03], [-0.02]]) * torch.arange(40.0) + torch.tensor([[1.0], [4.0]])
    return [(wander,), (turn_back,)]


def _path(paths):
    n = paths.shape[1]
    step = paths.diff(dim=1, prepend=paths[:, :1]).flatten()
    for seam in range(n, len(step), n):
        ends = step[seam - 8].item(), step[seam + 8].item()
        step[seam - 7 : seam + 8] = torch.linspace(*ends, 17)[1:-1]
    return paths[0, 0] + step.cumsum(0)


def _joins(got, paths) -> str:
    L, n = paths.shape
    if wrong := _no_numbers(got, (L * n,)):
        return wrong
    path = torch.as_tensor(got).double()
    if abs(path[0] - paths[0, 0]) > 1e-3:
        return f"your path begins at {path[0]:.2f} m, expected {paths[0, 0]:.2f}"
    step, own = path.diff(), paths.double().diff(dim=1)
    for k in range(L):  # step[i - 1] leads to frame i
        first, last = 8 if k else 1, n - 8 if k < L - 1 else n - 1
        change = step[k * n + first - 1 : k * n + last] - own[k, first - 1 : last]
        if change.abs().max() > 1e-4:
            return f"walk {k} has other steps than its own, far from every seam"
    kink = step.diff().abs().max()
    if kink > 0.01:
        return f"somewhere a step is {100 * kink:.1f} cm longer or shorter than the one before"
    return ""


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
    "11.3": Exercise(
        "rests that nobody sees",
        _wave,
        "joints that rest together make a valley; let each rest at its own time, like a wave that "
        "runs through the body: joint k is k / 24 of the way from one rest to the next",
        lambda: [(90,), (150,)],
        _hides_its_rests,
    ),
    "11.4": Exercise(
        "cut at the border",
        _hard_frames,
        "the middles are the multiples of n from 0 to N, the first and the last moved inside by "
        "half a primitive; add -4 ... 3 to each",
        lambda: [(1024, 256), (1024, 128), (512, 256)],
        _at_borders,
    ),
    "11.5": Exercise(
        "who decides what",
        {
            "how many soft ones": False,
            "frames of the soft ones": True,
            "frames of the hard ones": False,
            "poses in the hard ones": True,
        },
        "the network has 13 places to fill, always; a border is where it is, whatever is danced "
        "there; and a primitive is cut from the dance",
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
    "12.4": Exercise(
        "a network that does not listen",
        {
            "a hard cue": True,
            "the frame beside a hard cue": False,
            "a soft cue, s = 0.5": False,
            "a soft cue, s = 1": False,
        },
        "the last step's result is the network's guess; what is put into it after that step, and "
        "what only before? Soft cues never follow the last step",
    ),
    "12.5": Exercise(
        "a path without a kink",
        _path,
        "go from places to steps, and let the steps, 7 before and 7 after a seam, change little "
        "by little; then add all steps up",
        _walks,
        _joins,
    ),
}
