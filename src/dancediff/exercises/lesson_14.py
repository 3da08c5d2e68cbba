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


def _write(logits, start, draws, top: int, tau: float):
    words = start
    for unit in draws.unbind(1):
        heard = [words[: i + 1] for i in range(len(start))]
        p, best = (torch.stack([logits(rows) for rows in heard]) / tau).softmax(-1).topk(top)
        sums = (p / p.sum(-1, keepdim=True)).cumsum(-1)
        place = (sums <= unit[:, None]).sum(-1, keepdim=True).clamp(max=top - 1)
        words = torch.cat([words, best.gather(-1, place)], dim=1)
    return words[:, start.shape[1] :]


def _gossip(k: int):
    """Scores of k words for which all counts: which words are heard, from whom and when."""

    def logits(heard):
        row, at = (torch.arange(1.0, size + 1) for size in heard.shape)
        told = torch.sin(heard + 0.7 * row[:, None] + 0.3 * at).sum()
        return 2 * torch.sin(told * torch.arange(1.0, k + 1))

    return logits


def _sentences() -> list[tuple]:
    draw = torch.Generator().manual_seed(3)
    cases = []
    sizes = [(3, 4, 6, 9, 4), (4, 1, 5, 7, 3), (1, 2, 8, 12, 12), (2, 3, 4, 6, 1)]
    for (n, s, u, k, top), tau in zip(sizes, (1.0, 2.0, 0.5, 1.0), strict=True):
        start = torch.randint(k, (n, s), generator=draw)
        cases.append((_gossip(k), start, torch.rand(n, u, generator=draw), top, tau))
    return cases


SPECS = {
    "14.1": {"spec": _roll, "cases": _rolls},
    "14.2": {"spec": _nearest, "cases": _books},
    "14.3": {"spec": perplexity, "cases": _uses},
    "14.5": {"spec": _write, "cases": _sentences},
}
