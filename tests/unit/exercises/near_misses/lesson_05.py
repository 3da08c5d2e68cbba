"""Plausible wrong answers to the exercises of lesson 05: A denoiser that listens."""

import torch

NEAR_MISSES = {
    "05.1": [
        {"simple": True, "vel": True, "fk": True, "contact": True, "dist": True},
        {"simple": True, "vel": False, "fk": True, "contact": False, "dist": True},
        {"simple": True, "vel": False, "fk": True, "contact": True, "dist": False},
        {"simple": True, "vel": False, "fk": True},
    ],
    "05.2": [
        lambda p_hat, p: (p_hat - p).square().mean(),  # places, not offsets
        lambda p_hat, p: (p_hat - p).diff(dim=0).square().mean(),  # neighbours only
        lambda p_hat, p: (p_hat - p).diff(dim=1).square().mean(),  # time, as the released code
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().mean(),  # with herself
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().sum(),
    ],
    "05.3": [
        lambda p: p,
        lambda p: p + 10,  # all aside: the distances are right
        lambda p: 10 * p,  # steps are ten times as long
        lambda p: p[:, torch.randperm(p.shape[1], generator=torch.Generator().manual_seed(0))],
        lambda p: torch.cat([p[:1] + 10, p[1:]]),  # the others stand well
        lambda p: p + 0.1 * torch.arange(len(p))[:, None, None],  # too little
        lambda p: p[0],
    ],
}
