"""Exercises of lesson 06: The sampling lab."""

from itertools import pairwise

import torch

from dancediff.diffusion.ddim import ddim_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.exercises.shared import unlike
from dancediff.extensions.frequency_clip import FrequencyClip
from dancediff.extensions.preconditioning import dct_matrix


def _guide(denoiser, x_t, w):
    without = denoiser(x_t, music=False)
    return without + w * (denoiser(x_t, music=True) - without)


def _guide_cases() -> list[tuple]:
    x_t = torch.randn(2, 3, 4, generator=torch.Generator().manual_seed(0))
    return [(_hears, x_t, w) for w in (0.0, 1.0, 2.0, 0.5)]


def _hears(x_t, music):
    return 0.5 * x_t + 1 if music else 0.3 * x_t - 2


def _clip_waves(x, mean, std, C):
    return FrequencyClip(mean, std)(x)


def _wild_guesses() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = []
    for f, d, size in ((12, 3, 1.0), (20, 2, 8.0), (16, 1, 0.01)):
        mean = 0.8 * torch.randn(d, generator=draw)
        std = torch.linspace(0.5, 0.01, f)[:, None] * torch.linspace(1, 2, d)
        cases.append((mean + size * torch.randn(f, d, generator=draw), mean, std, dct_matrix(f)))
    return cases


def _bent(path, y):
    return path + torch.linspace(0, 1, len(path)) * (y - path[-1])


def _paths() -> list[tuple]:
    second = torch.arange(60) / 30
    return [(0.4 * (5 * second).sin() - 0.3, 1.2), (0.3 * (7 * second[:31]).cos(), -0.9)]


def _is_bent(got, path, y) -> str:
    if wrong := unlike(got, path.shape):
        return wrong
    if abs(got[-1] - y) > 1e-3:
        return f"ends at {got[-1]:.3f} m, expected {y:.3f} m"
    if abs(got[0] - path[0]) > 1e-3:
        return f"starts at {got[0]:.3f} m, expected {path[0]:.3f} m, as before"
    share = abs(y - path[-1]).item() / (len(path) - 1)
    worst = (got - path).diff().abs().max().item()
    if worst > 2 * share + 1e-5:
        return f"a step changes by {worst / share:.1f} even shares, expected 2 at most"
    return ""


def _walk(denoise, x_T, times, abar, eta, noise):
    x = x_T
    for (t, t_next), z in zip(pairwise(times), noise, strict=True):
        guess = denoise(x, t)
        if t_next == -1:
            break
        eps = (x - abar[t].sqrt() * guess) / (1 - abar[t]).sqrt()
        left = abar[t] / abar[t_next]
        sigma = eta * ((1 - abar[t_next]) / (1 - abar[t]) * (1 - left)).sqrt()
        x = abar[t_next].sqrt() * guess + (1 - abar[t_next] - sigma**2).sqrt() * eps + sigma * z
    return guess


def _knows_little(x_t, t):
    return 0.6 * torch.tanh(x_t) + 0.3 * t / 1000


def _walk_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = []
    for times, eta in ((ddim_times(4), 0.0), (ddim_times(10), 1.0), ([999, 600, 99, -1], 0.5)):
        x_T = torch.randn(2, 3, 4, generator=draw, dtype=torch.float64)
        noise = torch.randn(len(times) - 1, 2, 3, 4, generator=draw, dtype=torch.float64)
        cases.append((_knows_little, x_T, times, cosine_abar(), eta, noise))
    return cases


SPECS = {
    "06.1": {"spec": _guide, "cases": _guide_cases},
    "06.2": {"spec": _clip_waves, "cases": _wild_guesses},
    "06.3": {"spec": _bent, "cases": _paths, "accepts": _is_bent},
    "06.4": {"spec": _walk, "cases": _walk_cases},
}
