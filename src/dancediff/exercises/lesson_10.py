"""Exercises of lesson 10: A long group dance.

Read first: notebook 10 · `dancediff.exercises.exercise`.
"""

from itertools import pairwise, permutations

import torch

from dancediff.axes import FPS
from dancediff.diffusion.ddim import ddim_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.exercises.shared import unlike


def _join(segments, overlap):
    return torch.cat([segments[0], *(s[:, overlap:] for s in segments[1:])], dim=1)


def _segments() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((3, 2, 10, 4, 5), (2, 1, 6, 3, 2), (1, 2, 8, 3, 4))  # segments, n, f, d, overlap
    cases = [(torch.randn(*shape, generator=draw), overlap) for *shape, overlap in sizes]
    return [(list(cases[0][0]), cases[0][1]), *cases]


def _backwards(first):
    return first.flip(1)[:, :FPS]


def _before_seams() -> list[tuple]:
    """Dancers who walk at 1.0 to 1.5 m/s when the seam comes (n, f, 3)."""
    second = torch.arange(45)[:, None] / FPS
    ways = torch.tensor([[1.2, 0.0, 0.3], [-1.0, 0.0, 0.2], [0.0, 0.0, 1.5]])
    starts = torch.tensor([[-1.0, 0.9, 0.0], [1.0, 0.9, 0.0], [0.0, 0.9, -1.0]])
    root = starts[:, None] + second * ways[:, None]
    return [(root,), (root[:2, :36],)]


def _hides_a_seam(got, first) -> str:
    if wrong := unlike(got, (len(first), FPS, 3)):
        return wrong
    jump = (got[:, 0] - first[:, -1]).norm(dim=-1).max().item()
    if jump > 0.01:
        return f"somebody jumps {100 * jump:.1f} cm across the seam, expected 1 cm at most"
    steps = got.diff(dim=1)
    if (farthest := steps.norm(dim=-1).max().item()) > 0.1:
        return f"a later step is {100 * farthest:.0f} cm long, expected 10 cm at most"
    before = first[:, -1] - first[:, -2]
    change = FPS * (steps[:, 0] - before).norm(dim=-1).max().item()
    return "" if change >= 1.5 else f"the velocity changes by {change:.1f} m/s only, expected 1.5"


def _shortest(start, places):
    way = torch.cdist(start, places)
    dancers = range(len(start))
    return torch.tensor(
        min(permutations(dancers), key=lambda goes: way[dancers, goes].sum().item())
    )


def _formations() -> list[tuple]:
    draw = torch.Generator().manual_seed(3)
    row = torch.stack([torch.linspace(-2, 2, 5), torch.zeros(5)], -1)
    turned = row[[3, 0, 4, 1, 2]] + torch.tensor([0.2, 1.0])
    return [
        (row, turned),
        *((2 * torch.randn(2, n, 2, generator=draw)).unbind() for n in (3, 4, 5, 5)),
    ]


def _danced(guess, z, known, start, times, abar):
    """A segment from its noise, rows from left to right; its first frames are known."""
    x, k = z, known.shape[1]
    for step, step_next in pairwise(times):
        a = abar[step]
        x = torch.cat([a.sqrt() * known + (1 - a).sqrt() * z[:, :k], x[:, k:]], dim=1)
        x_0 = guess(x, step, start)
        if step_next == -1:
            break
        b = abar[step_next]
        x = b.sqrt() * x_0 + ((1 - b) / (1 - a)).sqrt() * (x - a.sqrt() * x_0)
    return x_0


def _any_length(guess, root_x, noise, times, abar, overlap):
    stride = noise.shape[2] - overlap
    first = _danced(guess, noise[0], noise[0, :, :0], 0, times, abar)
    dance = first[root_x(first[:, 0]).argsort()]
    for number, z in enumerate(noise[1:], 1):
        start = number * stride
        known = dance[:, start:]
        order = root_x(known[:, 0]).argsort()
        x = _danced(guess, z, known[order], start, times, abar)
        dance = torch.cat([dance, x[order.argsort(), overlap:]], dim=1)
    return dance


def _walks_through_each_other(x, t, start):
    """A "network" that hears where it is, tells its rows apart and lets their paths cross."""
    n, f, _ = x.shape
    frame, row = start + torch.arange(f), torch.arange(n)
    way = torch.sin(1.9 * row[:, None] + 0.45 * frame)[..., None]
    return 0.6 * way + 0.25 * torch.tanh(x) + 0.15 * x.roll(1, 1) + 0.1 * t / 1000


def _last_number(frame):
    return frame[:, -1]


def _long_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((3, 4, 9, 2, 3), (4, 3, 6, 3, 4), (2, 5, 8, 1, 5), (1, 2, 7, 3, 2))  # k n f d overlap
    cases = []
    for steps, (*shape, overlap) in zip((3, 5, 4, 2), sizes, strict=True):
        noise = torch.randn(*shape, generator=draw, dtype=torch.float64)
        parts = (_walks_through_each_other, _last_number, noise, ddim_times(steps))
        cases.append((*parts, cosine_abar(), overlap))
    return cases


SPECS = {
    "10.1": {"spec": _join, "cases": _segments},
    "10.2": {"spec": _backwards, "cases": _before_seams, "accepts": _hides_a_seam},
    "10.3": {"spec": _shortest, "cases": _formations},
    "10.4": {"spec": _any_length, "cases": _long_cases},
}
