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


def by_sum(p, best, draw):
    return best[(p.cumsum(0) <= draw).sum().clamp(max=len(p) - 1)]


def likely(p, top):
    p, best = p.topk(top)
    return p / p.sum(), best


def by_number(p, top):
    best = p.topk(top).indices.sort().values
    return p[best] / p[best].sum(), best


def told(
    *,
    heard=lambda words, new, i: words[: i + 1],
    scale=lambda score, tau: score / tau,
    keep=likely,
    choose=by_sum,
):
    """Words of dancers in turn, with one part replaced; with none it is right."""

    def answer(logits, start, draws, top, tau):
        words = start
        for unit in draws.unbind(1):
            new = []
            for i, draw in enumerate(unit):
                p = scale(logits(heard(words, new, i)), tau).softmax(-1)
                new.append(choose(*keep(p, top), draw))
            words = cat([words, torch.stack(new)[:, None]], dim=1)
        return words[:, start.shape[1] :]

    return answer


def hears_the_new(words, new, i):
    """Also what others have chosen for this unit; the dancer's own word is 0 so far."""
    return cat([words[: i + 1], torch.tensor([*new, 0])[:, None]], dim=1)


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
    "14.5": [
        told(heard=lambda words, new, i: words[i : i + 1]),  # alone
        told(heard=lambda words, new, i: words.roll(-1 - i, 0)),  # all, also those behind
        told(heard=lambda words, new, i: words[: i + 1].flip(0)),  # itself first
        told(heard=lambda words, new, i: words[: i + 1, -1:]),  # the last unit only
        told(heard=hears_the_new),
        told(choose=lambda p, best, draw: best[0]),  # the likeliest
        told(choose=lambda p, best, draw: best[int(draw * len(best))]),  # all alike
        told(choose=lambda p, best, draw: best[(p - draw).abs().argmin()]),
        told(choose=lambda p, best, draw: by_sum(p, best, 1 - draw)),  # the unlikeliest first
        told(choose=lambda p, best, draw: (p.cumsum(0) <= draw).sum().clamp(max=len(p) - 1)),
        told(choose=lambda p, best, draw: best[((p.cumsum(0) <= draw).sum() - 1).clamp(min=0)]),
        told(scale=lambda score, tau: score * tau),
        told(scale=lambda score, tau: score),  # no temperature
        told(scale=lambda score, tau: score.softmax(-1) / tau),  # softmax twice
        told(keep=by_number),  # adds up in the order of the codes
        told(keep=lambda p, top: p.topk(top)),  # not divided
        told(keep=lambda p, top: likely(p, len(p))),  # all words
        lambda logits, start, *given: cat([start, told()(logits, start, *given)], dim=1),
        lambda logits, start, draws, *given: told()(logits, start, draws.flip(1), *given),
    ],
}
