"""Plausible wrong answers to the exercises of lesson 07: Who stands where?"""

from functools import partial

import torch


def prior(x, C, wrong):
    """Exercise 07.5 with one mistake."""
    if wrong == "ranked at every frame":
        x = x.sort(1).values
    elif wrong != "not ranked":
        when = -1 if wrong == "ranked at the end" else 0
        x = x.take_along_dim(x[:, :, when].argsort(1)[:, :, None], 1)
    place = (x if wrong == "all frames" else x[:, :, 0]).mean(
        (0, 2) if wrong == "all frames" else 0
    )
    S = x[:, :, -1].argsort(1)
    way = place[S if wrong == "S for its inverse" else S.argsort(1)] - place
    if wrong == "a dancer's own way":
        way = x[:, :, -1] - place
    gone = x - place[:, None]
    progress = (way[:, :, None] * gone).sum((0, 1)) / way.square().sum()
    if wrong == "the mean of shares":
        shares = gone / way[:, :, None]
        progress = shares[way.abs() > 0].mean(0)
    elif wrong == "not divided":
        progress = (way[:, :, None] * gone).mean((0, 1))
    left = gone if wrong == "who changes places varies" else gone - progress * way[:, :, None]
    waves = {"no DCT": left, "transposed": left @ C}.get(wrong, left @ C.T)
    waves = waves.nan_to_num()  # where nobody has any way to go
    size, basis = torch.linalg.eigh(waves.permute(2, 1, 0) @ waves.permute(2, 0, 1) / len(x))
    if wrong == "rows for columns":
        basis = basis.mT
    elif wrong == "unsorted":
        size = size.flip(-1)
    return place, progress, basis, size if wrong == "no root" else size.sqrt()


PRIOR_MISTAKES = (
    "not ranked",
    "ranked at every frame",  # nobody ever changes places
    "ranked at the end",
    "all frames",  # the place is a mean over time
    "S for its inverse",
    "a dancer's own way",
    "the mean of shares",  # not the least squares
    "not divided",
    "who changes places varies",  # the way is not taken out
    "no DCT",
    "transposed",
    "rows for columns",
    "unsorted",  # sizes of other formations
    "no root",  # the variance
)


NEAR_MISSES = {
    "07.1": [
        lambda h: h,  # nobody hears anybody
        lambda h: h + h.roll(1, dims=1),  # depends on the neighbour in the list only
        lambda h: h + h.cumsum(1),  # the first hears herself only
        lambda h: h + h.mean(2, keepdim=True),  # over the frames
        lambda h: h + torch.arange(h.shape[1])[:, None, None] * h.mean(1, keepdim=True),  # names
        lambda h: h.mean(1),
        lambda h: h + h.mean(),  # over the groups, too
        lambda h: h - h[:, :1],  # only the first is heard
        lambda h: h + h.amax(1, keepdim=True),  # only who has the largest numbers is heard
        lambda h: h.mean(1, keepdim=True).expand_as(h) + 0 * h.cumsum(1) + h.flip(1),
    ],
    "07.2": [
        {"nothing": True, "FP": True, "DPE": True, "DPE, FP": True, "all": True},
        {"nothing": False, "FP": False, "DPE": True, "DPE, FP": True, "all": True},
        {"nothing": False, "FP": False, "DPE": False, "DPE, FP": True, "all": True},
        {"nothing": False},
    ],
    "07.3": [
        lambda root: root[:, 0, 0].argsort(),  # who stands k-th, not which k
        lambda root: root[:, -1, 0].argsort().argsort(),  # at the last frame
        lambda root: root[:, 0, 2].argsort().argsort(),  # in depth
        lambda root: root[:, 0, 0].argsort(descending=True).argsort(),
        lambda root: root[:, 0, 0].argsort().argsort() + 1,
        lambda root: root[:, :, 0].argsort(0).argsort(0),  # of every frame
        lambda root: -root[:, 0, 0].argsort().argsort() + len(root) - 1,  # from the right
        lambda root: root[:, 0, 0].argsort().argsort().argsort(),  # once too often
        lambda root: root.mean(1)[:, 0].argsort().argsort(),  # on average
    ],
    "07.4": [
        lambda tokens, table: tokens + table.repeat_interleave(len(tokens) // len(table), 0),
        lambda tokens, table: tokens + table[0],
        lambda tokens, table: tokens + table.flip(0).repeat(len(tokens) // len(table), 1),
        lambda tokens, table: table.repeat(len(tokens) // len(table), 1),  # the tokens are lost
        lambda tokens, table: torch.cat([tokens[: len(table)] + table, tokens[len(table) :]]),
        lambda tokens, table: tokens + table.repeat(len(tokens) // len(table), 1).roll(1, 0),
        lambda tokens, table: tokens + table.mean(0),
        lambda tokens, table: tokens * table.repeat(len(tokens) // len(table), 1),
    ],
    "07.5": [
        *(partial(prior, wrong=wrong) for wrong in PRIOR_MISTAKES),
        lambda x, C: prior(x, C, "")[:3],
        lambda x, C: tuple(reversed(prior(x, C, ""))),
    ],
}
