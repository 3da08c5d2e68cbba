"""Plausible wrong answers to the exercises of lesson 09: Changing places."""

from itertools import pairwise

import torch

from dancediff.exercises import EXERCISES


def as_places(x, S, gap):
    """The places of the guess, given out in the order S; the gap is forgotten."""
    y = x.clone()
    y[S] = x.sort().values
    return y


def evenly(x, S, gap):
    """Right, but moves those who stand well, too."""
    y = x.clone()
    y[S] = x.mean() + gap * (torch.arange(len(x)) - (len(x) - 1) / 2)
    return y


def pushed_right(x, S, gap):
    """In order, but the whole group drifts."""
    y = x.clone()
    for left, right in pairwise(S):
        y[right] = max(x[right], y[left] + gap)
    return y


def with_zeros(steps):
    return torch.cat([torch.zeros_like(steps[:, :1]), steps], dim=1)


NEAR_MISSES = {
    "09.1": [
        lambda S1, S2: S2[S1],  # the wrong way round
        lambda S1, S2: S2,
        lambda S1, S2: S1.argsort()[S2],  # where a rank goes, not who stands in a place
        lambda S1, S2: S1[S2].argsort(),
        lambda S1, S2: (S1 + S2) % len(S1),
        lambda S1, S2: S2.argsort()[S1],
        lambda S1, S2: S1,
        lambda S1, S2: torch.arange(len(S1)),
    ],
    "09.2": [
        as_places,
        evenly,
        pushed_right,
        lambda x, S, gap: x,
        lambda x, S, gap: x[S],
        lambda x, S, gap: evenly(x, S.argsort(), gap),  # the wrong way round
        lambda x, S, gap: EXERCISES["09.2"].spec(x, S, torch.tensor(0.45)),  # the usual gap
        lambda x, S, gap: EXERCISES["09.2"].spec(x, S, 0.9 * gap),
        lambda x, S, gap: EXERCISES["09.2"].spec(x, torch.arange(len(x)), gap),  # S is forgotten
    ],
    "09.3": [
        lambda root: with_zeros(root[..., [0, 2]].diff(dim=1)),  # per frame, as the released code
        lambda root: with_zeros(30 * root[..., :2].diff(dim=1)),  # height for depth
        lambda root: with_zeros(30 * root.diff(dim=1)),  # in space
        lambda root: 30 * root[..., [0, 2]].diff(dim=1),  # a frame is missing
        lambda root: with_zeros(30 * root[..., [0, 2]].diff(dim=1)).roll(-1, dims=1),  # behind
        lambda root: with_zeros(30 * root[..., [0, 2]].diff(dim=1)).norm(dim=-1),  # no direction
        lambda root: with_zeros(30 * root[..., [2, 0]].diff(dim=1)),  # z before x
        lambda root: with_zeros(-30 * root[..., [0, 2]].diff(dim=1)),
        lambda root: torch.cat([x[:, :1] for x in [30 * root[..., [0, 2]].diff(dim=1)]] * 1, 1),
    ],
}
