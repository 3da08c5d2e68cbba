"""Plausible wrong answers to the exercises of lesson 05: A denoiser that listens."""

import torch

from dancediff.exercises import EXERCISES

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
        lambda p_hat, p: 3 * EXERCISES["05.2"].spec(p_hat, p),  # the sum over x, y, z
        lambda p_hat, p: EXERCISES["05.2"].spec(p_hat, p).sqrt(),
        lambda p_hat, p: (p_hat - p).var(dim=0).mean(),  # half of it
        lambda p_hat, p: (  # distances instead of offsets
            (torch.pdist(p_hat[:, 0]) - torch.pdist(p[:, 0])).square().mean()
        ),
        lambda p_hat, p: EXERCISES["05.2"].spec(p_hat[..., [0, 2]], p[..., [0, 2]]),  # no height
    ],
    "05.3": [
        lambda p: p,
        lambda p: p + 10,  # all aside: the distances are right
        lambda p: 10 * p,  # steps are ten times as long
        lambda p: p[:, torch.randperm(p.shape[1], generator=torch.Generator().manual_seed(0))],
        lambda p: torch.cat([p[:1] + 10, p[1:]]),  # the others stand well
        lambda p: p + 0.1 * torch.arange(len(p))[:, None, None],  # too little
        lambda p: p[0],
        lambda p: p + 0.6 * torch.arange(len(p))[:, None, None] * torch.eye(3)[0],  # only in a row
        lambda p: p + 0.6 * torch.arange(len(p))[:, None, None] * torch.eye(3)[2],
        lambda p: p.flip(0),  # exchanged: steps change
        lambda p: p + 10 * torch.linspace(0, 1, p.shape[1])[:, None],  # all drift
    ],
}
