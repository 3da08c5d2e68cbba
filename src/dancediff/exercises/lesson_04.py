"""Exercises of lesson 04: Destroying a dance.

Read first: notebook 04 · `dancediff.exercises.exercise`.
"""

import torch

from dancediff.diffusion.schedule import cosine_abar, q_sample


def _x0_from(x_t, eps, t, abar):
    return (x_t - (1 - abar[t]).sqrt() * eps) / abar[t].sqrt()


def _x0_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    abar = cosine_abar(1000)
    cases = []
    for t in (0, 250, 800):
        x_0, eps = torch.randn(2, 2, 3, 4, generator=draw, dtype=torch.float64)
        cases.append((q_sample(x_0, t, abar, eps), eps, t, abar))
    return cases


def _further(x_s, s, t, abar, eps):
    left = abar[t] / abar[s]
    return left.sqrt() * x_s + (1 - left).sqrt() * eps


def _further_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    x_s, eps = (torch.randn(2, 3, 4, generator=draw, dtype=torch.float64) for _ in range(2))
    return [(x_s, s, t, cosine_abar(1000), eps) for s, t in ((300, 600), (599, 600), (0, 900))]


def _noise_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    noises = [
        torch.randn(n, f, 151, generator=draw, dtype=torch.float64) for n, f in ((3, 20), (1, 9))
    ]
    return [(eps, cosine_abar(1000)) for eps in noises]


def _fool_the_loss(eps, abar):
    return 950, eps + 0.1


def _fools_the_loss(got, eps, abar) -> str:
    t, guess = got
    if t != int(t) or not 0 <= t <= 960:
        return f"t = {t}, expected a noise level from 0 to 960"
    if guess.shape != eps.shape:
        return f"shape {tuple(guess.shape)} of the guess, expected {tuple(eps.shape)}"
    loss = ((guess - eps) ** 2).mean().item()
    if not loss <= 0.01 + 1e-6:
        return f"the loss is {loss:.3g}, expected at most 0.01"
    a = abar[int(t)].item()
    error = (loss * (1 - a) / a) ** 0.5
    return "" if error >= 1 else f"the dance is wrong by {error:.2f}, expected 1 or more"


def _even_abar(num_steps):
    return torch.linspace(0.99, 0.0005, num_steps)


def _is_a_plan(got, num_steps) -> str:
    abar = torch.as_tensor(got).double()
    if abar.shape != (num_steps,):
        return f"shape {tuple(abar.shape)}, expected ({num_steps},)"
    if not (abar > 0).all() or not (abar[:-1] > abar[1:]).all():
        return "some of your numbers do not fall, or are not above 0"
    if not 0.95 <= abar[0] <= 1 or not abar[-1] <= 0.001 + 1e-6:
        return (
            f"yours goes from {abar[0]:.3g} to {abar[-1]:.3g}, expected 0.95 … 1 to 0.001 or less"
        )
    middle = ((abar > 0.1) & (abar < 0.9)).double().mean().item()
    return "" if middle >= 0.7 else f"{middle:.0%} of the steps are in the middle, expected 70%"


def _training_step(net, W, batch, abar, weight, rate):
    x_0, M, t, eps, keep = (batch[name] for name in ("x_0", "M", "t", "eps", "keep"))
    W = W.clone().requires_grad_()
    guess = net(W, q_sample(x_0, t, abar, eps), t, M * keep[:, None, None])
    loss = (weight[t] * (guess - x_0).square().mean((1, 2, 3))).mean()
    (slope,) = torch.autograd.grad(loss, W)
    return loss.item(), (W - rate * slope / slope.norm().clamp(min=1)).detach()


def _linear(W, x_t, t, M):
    """A guess that is a weighted sum of noisy dance, music, noise level and 1."""
    level = (t / 1000).reshape(-1, 1, 1, 1).expand(*x_t.shape[:3], 1)
    music = M[:, None].expand(-1, x_t.shape[1], -1, -1)
    inputs = torch.cat([x_t, music, level, torch.ones_like(level)], dim=-1)
    return torch.tanh(inputs.to(W.dtype) @ W)


def _batches() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = []
    for (b, n, f, d, m), size in (((3, 2, 5, 4, 6), 0.7), ((4, 3, 2, 5, 1), 6.0)):
        batch = {
            "x_0": size * torch.randn(b, n, f, d, generator=draw),
            "M": torch.randn(b, f, m, generator=draw) + 1,
            "t": torch.tensor([500, 40, 900, 250][:b]),
            "eps": torch.randn(b, n, f, d, generator=draw),
            "keep": torch.tensor([True, False, True, True][:b]),
        }
        W = 0.4 * torch.randn(d + m + 2, d, generator=draw)
        weight = torch.linspace(0.2, 3.0, 1000)
        cases.append((_linear, W, batch, cosine_abar(1000), weight, 0.5))
    return cases


def _is_a_step(got, net, W, batch, abar, weight, rate) -> str:
    loss, moved = got
    right, there = _training_step(net, W, batch, abar, weight, rate)
    loss = float(torch.as_tensor(loss).detach())
    if not abs(loss - right) <= 1e-3 * right:
        return f"the loss is {loss:.4g}, expected {right:.4g}"
    moved = torch.as_tensor(moved).detach()
    if moved.shape != W.shape:
        return f"the loss is right; shape {tuple(moved.shape)} of W, expected {tuple(W.shape)}"
    if not (moved - there).norm() <= 1e-3 * (there - W).norm():
        yours, far = (moved - W).norm(), (there - W).norm()
        return f"the loss is right; W moves by {yours:.4g}, expected {far:.4g}, down the gradient"
    return ""


SPECS = {
    "04.1": {"spec": _x0_from, "cases": _x0_cases},
    "04.2": {"spec": _further, "cases": _further_cases},
    "04.4": {"spec": _fool_the_loss, "cases": _noise_cases, "accepts": _fools_the_loss},
    "04.5": {"spec": _even_abar, "cases": lambda: [(1000,), (50,)], "accepts": _is_a_plan},
    "04.6": {"spec": _training_step, "cases": _batches, "accepts": _is_a_step},
}
