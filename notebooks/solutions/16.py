"""Solutions of lesson 16."""

# %% 16.1
# A row of the network is a frame with all its dancers, so frames go before dancers, and back again.
# Each place has weights of its own: that is where left and right become different.


def fuse(h, mix):
    b, n, f, d = h.shape
    rows = h.transpose(1, 2).reshape(b, f, n * d)
    return mix(rows).reshape(b, f, n, d).transpose(1, 2)


# %% 16.2
# Frame i reads (C) what frame j wrote (B), faded by all decays in between: the difference of two
# running sums. The future has not been written yet: its fade is exp(-inf) = 0. With tril behind the
# exp the dance is the same, but exp of a large gap is infinite, and its gradient no number.
import torch


def ssd(u, a, B, C):
    total = a.cumsum(-1)
    gap = total[..., :, None] - total[..., None, :]
    future = torch.ones_like(gap, dtype=torch.bool).triu(1)
    return (gap.masked_fill(future, -torch.inf).exp() * (C @ B.mT)) @ u


# %% 16.3
# Of 2^songs equally likely rows of tosses, count those with so many heads or more. With four songs
# even four wins are luck once in sixteen times.
from math import comb


def luck(wins, songs):
    return sum(comb(songs, k) for k in range(wins, songs + 1)) / 2**songs


# %% 16.4
# A hard song is hard for both networks. Their difference on one song leaves that out, so pairs give
# a narrower interval than two rows that are drawn each for itself. A song without the score of one
# of them says nothing about the difference, and must not be drawn.
import numpy as np


def compare(mine, other, draws):
    rows = []
    for column in range(mine.shape[1]):
        a, b = mine[:, column], other[:, column]
        both = np.isfinite(a) & np.isfinite(b)
        a, b = a[both], b[both]
        k = len(a)
        songs = np.floor(k * draws[:, :k]).astype(int)  # (r, k)
        means = (a - b)[songs].mean(axis=1)
        low, high = np.quantile(means, (0.025, 0.975))
        rows.append((a.mean(), (a - b).mean(), low, high))
    return np.array(rows)
