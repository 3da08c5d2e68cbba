"""Exercises of lesson 14: What came before.

Read first: lesson 14 · `dancediff.autoregression.roll_out` · `dancediff.nn.quantizer`.
"""

import torch

from dancediff.nn.quantizer import perplexity


def _go_on(history):
    """Three guesses on the straight line through the last two frames; each needs the one before."""
    ahead = torch.arange(1.0, 4)[:, None]
    return history[:, -1:] + ahead * (history[:, -1:] - history[:, -2:-1])


def _fade(history):
    """A weighted mean of everything that it sees, so a window of another length shows; two."""
    weights = torch.linspace(0.2, 1.4, history.shape[1])[:, None]
    mean = (weights * history).mean(1, keepdim=True)
    return torch.cat([mean, 2 * mean], dim=1)


def _roll(step, seed, frames: int):
    dance, seen = seed, seed.shape[1]
    for _ in range(frames):
        dance = torch.cat([dance, step(dance[:, -seen:])[:, :1]], dim=1)
    return dance[:, seen:]


def _rolls() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    seeds = [torch.randn(size, generator=draw) for size in ((2, 4, 3), (1, 6, 2), (3, 5, 4))]
    return [(_fade, seeds[0], 5), (_go_on, seeds[1], 7), (_fade, seeds[2], 9)]


def _nearest(z, e):
    return (z[:, :, None] - e).square().sum(-1).argmin(-1)


def _books() -> list[tuple]:
    draw = torch.Generator().manual_seed(1)
    sizes = [((2, 9, 4), (5, 4)), ((3, 7, 6), (6, 6)), ((1, 12, 3), (20, 3))]
    cases = []
    for z, e in sizes:
        longer = torch.linspace(0.3, 3.0, e[0])[:, None]  # codes of all lengths
        cases.append((torch.randn(z, generator=draw), longer * torch.randn(e, generator=draw)))
    return cases


def _uses() -> list[tuple]:
    draw = torch.Generator().manual_seed(2)
    unlike = torch.multinomial(torch.arange(1.0, 9), 60, replacement=True, generator=draw)
    return [
        (unlike.reshape(3, 20), 16),  # some codes are never used
        (torch.tensor([0, 1, 2, 3]), 4),
        (torch.tensor([5, 5, 5, 5, 5, 2]), 32),
        (torch.tensor([7, 7, 7]), 8),  # one code only
    ]


SPECS = {
    "14.1": {"spec": _roll, "cases": _rolls},
    "14.2": {"spec": _nearest, "cases": _books},
    "14.3": {"spec": perplexity, "cases": _uses},
}
