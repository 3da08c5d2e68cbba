"""Plausible wrong answers to the exercises of lesson 16: Your own TCDiff++."""

from math import comb

import numpy as np
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


def masked_too_late(u, a, B, C):
    """exp of a large number is infinite, and 0 times that is none."""
    total = a.cumsum(-1)
    fade = (total[..., :, None] - total[..., None, :]).exp()
    return (torch.ones_like(fade).tril() * fade * (C @ B.mT)) @ u


def only_the_past(u, a, B, C):
    return torch.tril((C @ B.mT) * segsum(a).exp(), -1) @ u


def compared(
    mine, other, draws, *, ends=(0.025, 0.975), middle=np.mean, drop=True, own=False, apart=False
):
    """A row of the table that was made in one of several wrong ways."""
    rows = []
    for mine_all, other_all in zip(mine.T, other.T, strict=True):
        both = np.isfinite(mine_all) & np.isfinite(other_all)
        a, b, k = mine_all[both], other_all[both], both.sum()
        picks = (k * draws[:, :k]).astype(int)
        if not drop:  # of all songs, and those that are missing are left out afterwards
            picks = (len(mine) * draws).astype(int)
            means = np.nanmean((mine_all - other_all)[picks], axis=1)
        else:
            others = picks[::-1] if apart else picks
            means = a[picks].mean(axis=1) - b[others].mean(axis=1)
        mean = np.nanmean(mine_all) if own else middle(a)
        rows.append((mean, middle(a - b), *np.quantile(means, ends)))
    return np.array(rows)


def by_formula(mine, other, draws):
    """Two standard errors on both sides: no draws."""
    rows = compared(mine, other, draws)
    for row, gaps in zip(rows, (mine - other).T, strict=True):
        gap = gaps[np.isfinite(gaps)]
        half = 1.96 * gap.std(ddof=1) / len(gap) ** 0.5
        row[2:] = row[1] - half, row[1] + half
    return rows


def of_my_mean(mine, other, draws):
    """The interval of what mine has, not of the difference."""
    rows = compared(mine, other, draws)
    rows[:, 2:] = compared(mine, np.where(np.isfinite(other), 0, np.nan), draws)[:, 2:]
    return rows


def along_the_draws(mine, other, draws):
    """Means over the draws instead of over the songs of one."""
    rows = compared(mine, other, draws)
    for row, gaps in zip(rows, (mine - other).T, strict=True):
        gap = gaps[np.isfinite(gaps)]
        picks = (len(gap) * draws[:, : len(gap)]).astype(int)
        row[2:] = np.quantile(gap[picks].mean(axis=0), (0.025, 0.975))
    return rows


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
        masked_too_late,
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
    "16.4": [
        by_formula,
        of_my_mean,
        along_the_draws,
        lambda *case: compared(*case, apart=True),  # each network has songs of its own
        lambda *case: compared(*case, own=True),  # the mean of songs that the other lacks, too
        lambda *case: compared(*case, drop=False),
        lambda *case: compared(*case, ends=(0.05, 0.95)),
        lambda *case: compared(*case, ends=(0, 1)),
        lambda *case: compared(*case, middle=np.median),
        lambda mine, other, draws: compared(other, mine, draws),
        lambda mine, other, draws: compared(np.nan_to_num(mine), np.nan_to_num(other), draws),
        lambda mine, other, draws: compared(mine, other, draws[:, ::-1]),  # the last k numbers
        lambda *case: compared(*case).T,
    ],
}
