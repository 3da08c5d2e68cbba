"""Plausible wrong answers to the exercises of lesson 07: Who stands where?"""

import torch

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
}
