"""Plausible wrong answers to the exercises of lesson 04: Destroying a dance."""

import torch

from dancediff.diffusion.schedule import cosine_abar


def step(*, mix=None, hear=None, see=None, loss=None, shorten=None, sign=1.0, out=None):
    """A step of training in which one part is another."""
    mix = mix or (lambda a, x_0, eps: a.sqrt() * x_0 + (1 - a).sqrt() * eps)
    hear = hear or (lambda M, keep: M * keep[:, None, None])
    see = see or (lambda t: t)
    loss = loss or (lambda error, w, eps: (w * error.square().mean((1, 2, 3))).mean())
    shorten = shorten or (lambda slope: slope / slope.norm().clamp(min=1))

    def answer(net, W, batch, abar, weight, rate):
        x_0, t, eps = batch["x_0"], see(batch["t"]), batch["eps"]
        x_t = mix(abar[t].reshape(-1, 1, 1, 1), x_0, eps).float()
        moved = W.clone().requires_grad_()
        guess = net(moved, x_t, t, hear(batch["M"], batch["keep"]))
        value = loss(guess - x_0, weight[t], eps - x_0)
        (slope,) = torch.autograd.grad(value, moved)
        moved = (moved - sign * rate * shorten(slope)).detach()
        return (value.item(), moved) if out is None else out(value.item(), moved, W)

    return answer


def step_on_the_spot(net, W, batch, abar, weight, rate):
    value, _ = step()(net, W, batch, abar, weight, rate)
    return value, W


def step_twice(net, W, batch, abar, weight, rate):
    value, W = step()(net, W, batch, abar, weight, rate)
    return value, step()(net, W, batch, abar, weight, rate)[1]


NEAR_MISSES = {
    "04.1": [
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]) * eps) / abar[t].sqrt(),  # no root
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]).sqrt() * eps) / abar[t],
        lambda x_t, eps, t, abar: (x_t + (1 - abar[t]).sqrt() * eps) / abar[t].sqrt(),
        lambda x_t, eps, t, abar: x_t - eps,
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t - 1]).sqrt() * eps) / abar[t - 1].sqrt(),
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]).sqrt() * eps) * abar[t].sqrt(),
        lambda x_t, eps, t, abar: (x_t - abar[t].sqrt() * eps) / (1 - abar[t]).sqrt(),
    ],
    "04.2": [
        lambda x_s, s, t, abar, eps: (
            abar[t].sqrt() * x_s + (1 - abar[t]).sqrt() * eps
        ),  # from s = 0
        lambda x_s, s, t, abar, eps: (
            (abar[t] / abar[s]).sqrt() * x_s + (1 - abar[t]).sqrt() * eps
        ),  # all the noise a second time
        lambda x_s, s, t, abar, eps: (
            (abar[t] / abar[s]).sqrt() * x_s + (abar[s] - abar[t]).sqrt() * eps
        ),
        lambda x_s, s, t, abar, eps: (
            (abar[t - s].sqrt() * x_s) + (1 - abar[t - s]).sqrt() * eps
        ),  # as if all steps were alike
        lambda x_s, s, t, abar, eps: (
            (abar[t] / abar[s]) * x_s + (1 - abar[t] / abar[s]) * eps
        ),  # no roots
    ],
    "04.3": [
        {"sway": 50, "kick": 280, "tremble": 620},
        {"sway": 280, "kick": 620, "tremble": 50},
        {"sway": 280, "kick": 280, "tremble": 280},  # all at once
        {"sway": 620, "kick": 280},
    ],
    "04.4": [
        lambda eps, abar: (500, eps + 0.1),  # too early
        lambda eps, abar: (999, eps + 0.1),  # too late
        lambda eps, abar: (960, torch.zeros_like(eps)),  # a large loss
        lambda eps, abar: (960, eps),  # the right guess
        lambda eps, abar: (960, eps + 0.01),
        lambda eps, abar: (960, eps[0]),
        lambda eps, abar: (960.5, eps + 0.1),  # between two steps
        lambda eps, abar: (960, 1.2 * eps),  # a loss of 0.04
        lambda eps, abar: (eps + 0.1, 960),  # the other way round
    ],
    "04.5": [
        cosine_abar,  # 60% in the middle
        lambda num_steps: 1 - (torch.arange(num_steps) + 1) / num_steps,  # ends at 0
        lambda num_steps: torch.linspace(0.9, 0.1, num_steps),  # no beginning, no end
        lambda num_steps: torch.linspace(0.99, 0.05, num_steps),  # ends while a dance is left
        lambda num_steps: torch.linspace(0.0005, 0.99, num_steps),  # the other way
        lambda num_steps: torch.full((num_steps,), 0.5),
        lambda num_steps: torch.cumprod(1 - torch.linspace(1e-4, 0.02, num_steps), 0),
    ],
    "04.6": [
        step(mix=lambda a, x_0, eps: a * x_0 + (1 - a) * eps),  # no roots
        step(mix=lambda a, x_0, eps: a.sqrt() * x_0 + (1 - a.sqrt()) * eps),
        step(mix=lambda a, x_0, eps: (1 - a).sqrt() * x_0 + a.sqrt() * eps),  # exchanged
        step(mix=lambda a, x_0, eps: x_0),  # no noise
        step(mix=lambda a, x_0, eps: x_0 + (1 - a).sqrt() * eps),  # the dance keeps its strength
        step(see=lambda t: t[:1].expand_as(t)),  # one level for all
        step(hear=lambda M, keep: M),  # everybody hears
        step(hear=lambda M, keep: M * ~keep[:, None, None]),  # the others
        step(hear=lambda M, keep: 0 * M),
        step(loss=lambda error, w, eps: error.square().mean()),  # no weights
        step(loss=lambda error, w, eps: (w * error.square().mean((1, 2, 3))).sum() / w.sum()),
        step(loss=lambda error, w, eps: (w * error.square().mean((1, 2, 3))).sum()),
        step(loss=lambda error, w, eps: (w * error.square().sum((1, 2, 3))).mean()),
        step(loss=lambda error, w, eps: (w * error.abs().mean((1, 2, 3))).mean()),
        step(loss=lambda error, w, eps: ((w[:, None, None, None] * error) ** 2).mean()),
        step(loss=lambda error, w, eps: (w * (error - eps).square().mean((1, 2, 3))).mean()),
        step(shorten=lambda slope: slope),  # as long as it is
        step(shorten=lambda slope: slope / slope.norm()),  # always of length 1
        step(shorten=lambda slope: slope.clamp(-1, 1)),  # each number
        step(shorten=lambda slope: slope / slope.norm(dim=0).clamp(min=1)),  # each column
        step(shorten=lambda slope: slope.clamp(-0.1, 0.1)),
        step(sign=-1.0),  # up the gradient
        step(sign=0.5),
        step_on_the_spot,
        step_twice,
        step(out=lambda value, moved, W: moved),
        step(out=lambda value, moved, W: (moved, value)),
        step(out=lambda value, moved, W: (value, moved - W)),  # how far, not where to
    ],
}
