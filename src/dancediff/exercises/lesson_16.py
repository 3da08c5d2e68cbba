"""Exercises of lesson 16: Your own TCDiff++."""

from math import comb

import numpy as np
import torch

from dancediff.extensions.ssd import segsum


def _fuse(h, mix):
    rows = h.transpose(1, 2)  # (b, f, n, d)
    return mix(rows.flatten(2)).reshape(rows.shape).transpose(1, 2)


def _uneven_mix(row):
    """Every place in the row counts otherwise."""
    return row.flip(-1) * torch.arange(1, row.shape[-1] + 1) - 0.5 * row


def _groups() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((2, 3, 5, 4), (1, 2, 3, 2), (2, 4, 4, 4))  # b, n, f, d
    return [(torch.randn(*size, generator=draw), _uneven_mix) for size in sizes]


def _ssd(u, a, B, C):
    return ((C @ B.mT) * segsum(a).exp()) @ u


def _streams() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = []
    # in the long one exp of what fades until later is infinite
    for b, f, d, s in ((2, 6, 3, 4), (1, 9, 2, 1), (1, 300, 2, 2), (2, 5, 4, 4)):
        u, B, C = (torch.randn(b, f, width, generator=draw) for width in (d, s, s))
        cases.append((u, -torch.rand(b, f, generator=draw), B, C))
    return cases


def _luck(wins, songs):
    return sum(comb(songs, k) for k in range(wins, songs + 1)) / 2**songs


def _compare(mine, other, draws):
    rows = []
    for a, b in zip(mine.T, other.T, strict=True):
        both = np.isfinite(a) & np.isfinite(b)
        gap, k = (a - b)[both], both.sum()
        means = gap[(k * draws[:, :k]).astype(int)].mean(axis=1)
        rows.append((a[both].mean(), gap.mean(), *np.quantile(means, (0.025, 0.975))))
    return np.array(rows)


def _rivals() -> list[tuple]:
    """Scores of two networks that find the same songs hard; some are missing."""
    draw = np.random.default_rng(0)
    cases = []
    # songs that lack the first score, and those that lack the last one
    missing: list[tuple[list, list]] = [([1], []), ([0, 3], [5]), ([2], [2, 4])]
    for (b, m, r), (first, last) in zip(((6, 4, 60), (9, 3, 50), (7, 2, 40)), missing, strict=True):
        hard = draw.uniform(0, 2, (b, 1))
        mine, other = (hard + draw.uniform(0, 1, (b, m)) for _ in range(2))
        mine[first, 0], other[last, -1] = np.nan, np.nan
        cases.append((mine, other, draw.random((r, b))))
    return cases


SPECS = {
    "16.1": {"spec": _fuse, "cases": _groups},
    "16.2": {"spec": _ssd, "cases": _streams},
    "16.3": {"spec": _luck, "cases": lambda: [(4, 4), (6, 8), (8, 10), (5, 10), (0, 3), (55, 100)]},
    "16.4": {"spec": _compare, "cases": _rivals},
}
