"""Exercises of lesson 11: Think in phrases."""

import numpy as np
import torch

from dancediff.exercises.shared import NUMBERS, unlike
from dancediff.motion.beats import mean_speed
from dancediff.papers.lodge.primitives import Layout, primitive_frames


def _valleys(v):
    below = (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])
    return 1 + below.nonzero()[:, 0]


def _curves() -> list[tuple]:
    plateau = torch.tensor([3.0, 1.0, 1.0, 1.0, 2.0, 0.5, 2.0, 1.0])  # ends while it falls
    wave = torch.cos(torch.arange(90) / 7.0) + 0.3 * torch.cos(torch.arange(90) / 2.3)
    return [(plateau,), (wave,)]


def _wave(frames):
    when = torch.arange(frames)[:, None] / 30 + torch.arange(24) / 24
    return torch.stack([0.2 * torch.sin(torch.pi * when), 0 * when, 0 * when], -1)


def _hides_its_rests(got, frames) -> str:
    if wrong := unlike(got, (frames, 24, 3), NUMBERS):
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


def _forget(root):
    return root - root[:, :1] * root.new_tensor([1.0, 0.0, 1.0])


def _roots() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    return [(torch.randn(p, 8, 3, generator=draw).cumsum(1),) for p in (13, 2)]


def _plan(rests, energy, N, n):
    return primitive_frames(rests, Layout(N, n), energy.numpy())


def _half_minutes() -> list[tuple]:
    """Rests (frames) and energies in which each distance of the text decides something."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for N, n in ((512, 128), (768, 256), (256, 64)):
        energy = torch.rand(N, generator=draw, dtype=torch.float64)
        rests = {b for b in range(N) if torch.rand(1, generator=draw) < 0.1 and b // (n // 2) != 2}
        middle = N - n // 2  # of the last local
        loud = {11: 3.0, 12: 2.0, n - 12: 2.0, n - 11: 3.0}  # near the borders of the first
        loud |= {middle - 3: 4.0, middle + 4: 3.0, middle + 5: 2.0}  # near each other
        for b, value in loud.items():
            energy[b] = value
        cases.append((sorted(rests | loud.keys()), energy, N, n))
    return cases


SPECS = {
    "11.1": {"spec": _valleys, "cases": _curves},
    "11.2": {"spec": _wave, "cases": lambda: [(90,), (150,)], "accepts": _hides_its_rests},
    "11.3": {
        "spec": _hard_frames,
        "cases": lambda: [(1024, 256), (1024, 128), (512, 256)],
        "accepts": _at_borders,
    },
    "11.4": {"spec": _forget, "cases": _roots},
    "11.6": {"spec": _plan, "cases": _half_minutes},
}
