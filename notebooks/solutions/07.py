"""Solutions of lesson 07."""

# %% 07.1
# A mean is the same in whatever order one adds, so exchanged dancers get exchanged tokens; and
# everybody is in it, so everybody is heard. Attention is such a mean, with weights.


def hear_all(h):
    return h + h.mean(dim=1, keepdim=True)


# %% 07.2
# Without any of them all that the network does treats dancers alike. One part with weights of its
# own for each place in the row is enough; FP has them, too, though nobody calls it an embedding.
parts_them = {"nothing": False, "FP": True, "DPE": True, "DPE, FP": True, "all": True}


# %% 07.3
# Sorting tells who stands k-th. Sorting that order tells where in it everybody is found: the rank.
# The two are the same only for orders that are their own inverse, such as a plain exchange.


def ranks(root):
    order = root[:, 0, 0].argsort(stable=True)
    return order.argsort()


# %% 07.4
# In every frame the dancers come in the same order, so the table is repeated once for each frame.
# Each row repeated f times gives the first third of the clip to dancer 0, the next to dancer 1.


def mark(tokens, table):
    frames = len(tokens) // len(table)
    return tokens + table.repeat(frames, 1)


# %% 07.5
# The mean takes everything that place and order explain, so what is left shows how a group moves
# together. Every frequency has a covariance of its own, and its eigenvectors are the patterns that
# vary independently: to draw a group, draw a number for each of them.
from torch import einsum, linalg


def fit(x, C):
    order = x[:, :, 0].argsort(dim=1)
    x = x.take_along_dim(order[:, :, None], dim=1)
    place = x[:, :, 0].mean(0)
    S = x[:, :, -1].argsort(dim=1)
    way = place[S.argsort(dim=1)] - place  # (b, n)
    gone = x - place[:, None]
    progress = (way[:, :, None] * gone).sum((0, 1)) / way.square().sum()
    left = gone - progress * way[:, :, None]
    waves = left @ C.T
    covariance = einsum("bnf,bmf->fnm", waves, waves) / len(x)
    size, basis = linalg.eigh(covariance)
    return place, progress, basis, size.clamp(min=0).sqrt()
