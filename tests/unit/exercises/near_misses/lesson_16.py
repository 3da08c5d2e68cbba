"""Plausible wrong answers to the exercises of lesson 16: Your own TCDiff++."""

from math import comb

import torch

from dancediff.exercises import EXERCISES
from dancediff.extensions.ssd import segsum


def dancer_by_dancer(h, mix):
    """The rows are cut out of numbers that lie dancer by dancer."""
    b, n, f, d = h.shape
    return mix(h.reshape(b, f, n * d)).reshape(b, n, f, d)


def left_turned(h, mix):
    """The result has frames where dancers should be."""
    b, n, f, d = h.shape
    rows = h.transpose(1, 2).reshape(b, f, n * d)
    return mix(rows).reshape(b, n, f, d)


def one_number_at_a_time(h, mix):
    """All dancers' first numbers, then all second ones."""
    b, n, f, d = h.shape
    rows = h.permute(0, 2, 3, 1).reshape(b, f, d * n)
    return mix(rows).reshape(b, f, d, n).permute(0, 3, 1, 2)


def own_decay_too(u, a, B, C):
    """A frame fades what it writes itself."""
    return EXERCISES["16.2"].spec(u * a.exp()[..., None], a, B, C)


def no_decay(u, a, B, C):
    return torch.tril(C @ B.mT) @ u


def sees_the_future(u, a, B, C):
    total = a.cumsum(-1)
    return ((C @ B.mT) * (total[..., :, None] - total[..., None, :]).exp()) @ u


def only_the_past(u, a, B, C):
    return torch.tril((C @ B.mT) * segsum(a).exp(), -1) @ u


NEAR_MISSES = {
    "16.1": [
        dancer_by_dancer,
        left_turned,
        one_number_at_a_time,
        lambda h, mix: mix(h),
        lambda h, mix: h,
        lambda h, mix: EXERCISES["16.1"].spec(h.flip(1), mix),  # the row from right to left
        lambda h, mix: h + EXERCISES["16.1"].spec(h, mix),  # the residual comes later
    ],
    "16.2": [
        own_decay_too,
        no_decay,
        sees_the_future,
        only_the_past,
        lambda u, a, B, C: EXERCISES["16.2"].spec(u, a, C, B),  # reads with what writes
        lambda u, a, B, C: EXERCISES["16.2"].spec(u, -a, B, C),  # grows
        lambda u, a, B, C: EXERCISES["16.2"].spec(u, a.flip(-1), B, C),
        lambda u, a, B, C: ((C @ B.mT) + segsum(a)).softmax(-1) @ u,  # attention
    ],
    "16.3": [
        lambda wins, songs: comb(songs, wins) / 2**songs,  # exactly so many
        lambda wins, songs: EXERCISES["16.3"].spec(wins + 1, songs),  # more than so many
        lambda wins, songs: 2 * EXERCISES["16.3"].spec(wins, songs),  # either of the two
        lambda wins, songs: wins / songs,
        lambda wins, songs: 1 - wins / songs,
        lambda wins, songs: 1 - EXERCISES["16.3"].spec(wins, songs),
        lambda wins, songs: 0.5**wins,
    ],
}
