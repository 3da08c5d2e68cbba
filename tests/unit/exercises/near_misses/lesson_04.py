"""Plausible wrong answers to the exercises of lesson 04: Destroying a dance."""

import torch

from dancediff.diffusion.schedule import cosine_abar

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
        {"sway": 70, "kick": 310, "tremble": 650},
        {"sway": 310, "kick": 650, "tremble": 70},
        {"sway": 310, "kick": 310, "tremble": 310},  # all at once
        {"sway": 650, "kick": 310},
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
}
