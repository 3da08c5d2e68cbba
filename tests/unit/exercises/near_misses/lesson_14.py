"""Plausible wrong answers to the exercises of lesson 14: What came before."""

import torch
from torch import cat


def rolled(step, seed, frames, *, new=slice(0, 1), seen=lambda history, made: None):
    """A roll-out that keeps ``new`` of each guess and then sees what ``seen`` says."""
    history, made = seed, []
    while sum(part.shape[1] for part in made) < frames:
        made.append(step(history)[:, new])
        history = seen(history, made[-1])
    return cat(made, dim=1)[:, :frames]


def slide(history, new):
    return cat([history, new], dim=1)[:, -history.shape[1] :]


def distances(z, e):
    return (z[:, :, None] - e).square()


def shares(codes, num_codes):
    return torch.bincount(codes.flatten(), minlength=num_codes) / codes.numel()


def entropy(p):
    return torch.special.entr(p).sum()


NEAR_MISSES = {
    "14.1": [
        lambda step, seed, frames: rolled(step, seed, frames, seen=lambda h, _: h),  # the seed only
        lambda step, seed, frames: rolled(step, seed, frames, new=slice(None), seen=slide),  # all
        lambda step, seed, frames: rolled(step, seed, frames, new=slice(-1, None), seen=slide),
        lambda step, seed, frames: rolled(  # the window grows
            step, seed, frames, seen=lambda h, new: cat([h, new], dim=1)
        ),
        lambda step, seed, frames: rolled(  # the newest frame first
            step, seed, frames, seen=lambda h, new: cat([new, h[:, :-1]], dim=1)
        ),
        lambda step, seed, frames: rolled(  # overwrites the newest frame
            step, seed, frames, seen=lambda h, new: cat([h[:, :-1], new], dim=1)
        ),
        lambda step, seed, frames: cat([seed, rolled(step, seed, frames, seen=slide)], dim=1),
        lambda step, seed, frames: rolled(step, seed, frames + 1, seen=slide),
        lambda step, seed, frames: rolled(step, seed, frames + 1, seen=slide)[:, 1:],
        lambda step, seed, frames: step(seed),
    ],
    "14.2": [
        lambda z, e: distances(z, e).sum(2).argmin(-1),  # over codes, then a channel
        lambda z, e: distances(z, e).sum(1).argmin(-1),  # over time
        lambda z, e: distances(z, e).sum(-1).argmax(-1),
        lambda z, e: (z @ e.T).argmax(-1),  # the most alike in direction and length
        lambda z, e: distances(z, e).sum(-1).min(-1).values,  # how far, not which
        lambda z, e: (z[:, :, None] - e).sum(-1).abs().argmin(-1),  # errors cancel
        lambda z, e: distances(z, e).sum(-1).argmin(1),  # the nearest moment of each code
        lambda z, e: e[distances(z, e).sum(-1).argmin(-1)],  # the code itself
    ],
    "14.3": [
        lambda codes, k: entropy(shares(codes, k)),  # no power of e
        lambda codes, k: 2 ** entropy(shares(codes, k)),  # another base
        lambda codes, k: (shares(codes, k) > 0).sum(),  # how many are used at all
        lambda codes, k: (-entropy(shares(codes, k))).exp(),
        lambda codes, k: (shares(codes, k) * shares(codes, k).log()).sum().neg().exp(),  # 0 log 0
        lambda codes, k: entropy(shares(codes, k)).exp() / k,  # a share of the book
        lambda codes, k: (entropy(shares(codes, k)) / k).exp(),  # a mean over codes
        lambda codes, k: 1 / shares(codes, k).square().sum(),  # another count of the same kind
        lambda codes, k: entropy(shares(codes[:1], k)).exp(),  # of the first dance
    ],
    "14.4": [
        {"each alone: dances are exchanged": True, "GCD: dances are exchanged": True},
        {
            "each alone: dances are exchanged": True,
            "GCD: dances are exchanged": False,  # they hear each other, but nobody has a name
            "DPE: dances are exchanged": False,
            "GCD: dancer 0 always stands left": False,
            "DPE: dancer 0 always stands left": True,
        },
    ],
}
