r"""Sampling: from noise to a dance, by the steps of DDPM, DDIM or DPM-Solver++.

Read first: notebook 06 · `dancediff.diffusion.ddim`, whose symbols are used here.

The steps are pure functions that never see a network; `sample` is the loop around them.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from inspect import signature
from itertools import pairwise
from typing import Protocol

import torch
from torch import Tensor

from dancediff.diffusion.ddim import ddim_step, ddim_times
from dancediff.diffusion.ddpm import ddpm_step
from dancediff.diffusion.dpm_solver import dpm_step, logsnr_times
from dancediff.diffusion.pinning import Pin
from dancediff.diffusion.schedule import Generators, abar_at, cosine_abar, gaussian, send
from dancediff.own import is_own, own_function


class GuessHook(Protocol):
    """Changes every guess of a sampler before the next step is made from it."""

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Another guess; x0_hat is on the CPU, ``abar`` the signal power at its step."""
        ...


SAMPLERS = ("dpm", "ddim", "ddpm")


def own_step(name: str, x_t: Tensor, *where, **how) -> Tensor:
    """A step of a sampler of the user's own, "module:function".

    Raises: ValueError when it cannot be called like that, or returns another shape than x_t's.
    """
    function = own_function(name, "sampler")
    try:
        signature(function).bind(x_t, *where, **how)
    except TypeError as err:
        raise ValueError(f"sampler={name!r}: {err}; it is called as ddim_step is") from err
    return _like(x_t, function(x_t, *where, **how), f"sampler={name!r}")


def _like(x_t: Tensor, x: Tensor, who: str) -> Tensor:
    """What somebody else's function returned, if it is like x_t: else it would be spread to it."""
    if not isinstance(x, Tensor) or x.shape != x_t.shape:
        what = tuple(x.shape) if isinstance(x, Tensor) else type(x).__name__
        raise ValueError(f"{who} returned {what}; it must be like x_t {tuple(x_t.shape)}")
    return x


def sampling_times(
    sampler: str, steps: int, abar: Tensor | None = None, sigma_min: float = 0.0
) -> list[int]:
    """The steps that a sampler takes, from noise down to -1 ("clean"); by default of 1000.

    Raises: ValueError for an unknown sampler, or steps out of range.

    >>> sampling_times("ddim", 4), len(sampling_times("ddpm", 4))
    ([999, 749, 499, 249, -1], 1001)
    """
    abar = cosine_abar() if abar is None else abar
    if sampler not in SAMPLERS and not is_own(sampler):
        raise ValueError(f"sampler={sampler!r} is not one of {', '.join(map(repr, SAMPLERS))}")
    if sampler == "dpm":
        return logsnr_times(steps, abar, sigma_min)
    return ddim_times(len(abar) if sampler == "ddpm" else steps, len(abar))


def _cut(x0_hat: Tensor, clamp) -> Tensor:
    if clamp is None:
        return x0_hat
    return clamp(x0_hat) if callable(clamp) else x0_hat.clamp(-clamp, clamp)


def _hooked(x0_hat: Tensor, hooks: Sequence[GuessHook], abar: float) -> Tensor:
    if not hooks:
        return x0_hat
    x = x0_hat.cpu()
    for hook in hooks:
        x = hook.apply(x, abar)
    return send(x, x0_hat.device)


def _first(x_T: Tensor | None, shape: tuple, generator: Generators) -> Tensor:
    if x_T is None:
        return gaussian(shape, generator=generator)
    if x_T.shape != shape:
        raise ValueError(f"x_T {tuple(x_T.shape)} must have the shape {shape}")
    return x_T


@dataclass(frozen=True)
class SamplerOptions:
    """Which steps lead from noise to a dance.

    - ``sampler``: "dpm" or "ddim" (``steps``, ``eta``), or "ddpm" (always all T steps), or
      "module:function" of your own, called as `ddim_step` is, at the times of "ddim".
    - ``clamp``: guesses are cut at +- this, or by this function; None leaves them.
    - ``sigma_min``: where "dpm" takes its last guess, see `logsnr_times`; others pass it over.
    """

    abar: Tensor  # on the device that shall compute
    sampler: str
    steps: int
    eta: float
    clamp: float | Callable[[Tensor], Tensor] | None = 1.0
    sigma_min: float = 0.0


@torch.no_grad()
def sample(
    denoise: Callable[[Tensor, int], Tensor],
    shape: Sequence[int],
    options: SamplerOptions,
    *,
    generator: Generators = None,
    x_T: Tensor | None = None,
    pin: Pin | None = None,
    hooks: Sequence[GuessHook] = (),
    callback: Callable[[int, int, Tensor], None] | None = None,
) -> Tensor:
    r"""Start from noise and take every step of a sampler.

    $$x_T \sim \mathcal N(0, I), \qquad \hat x_0 = D(x_t, t), \qquad
      x_{t'} = \text{step}(x_t, \hat x_0), \qquad t = T - 1, \dots, -1$$

    Source: the code of EDGE, TCDiff++ and Lodge has T = 1000, 50 DDIM steps, eta = 1, x0_hat cut at
    +-1; the papers name neither, but for the 1000 steps of DDPM or 100 of DDIM in Lodge.

    - ``generator``: one for all noise, or a list of one for each row of the batch, so that rows are
      the same whatever others are sampled with them.
    - ``pin``: holds the first frames at known motion (`dancediff.diffusion.pinning.Pinning`).
    - ``hooks`` change every guess, one after the other, on the CPU: their tensors are small, and a
      GPU would have to be waited for at every branch.
    - ``callback(i, total, x0_hat)`` runs after step i, to draw pictures or a progress bar.

    Shapes: shape = (b, n, f, d); x_T like it, or None to draw it -> x_0 (b, n, f, d).
    Raises: ValueError for an unknown sampler, steps, eta or x_T out of range, or another guess.

    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> x_0, options = torch.rand(1, 2, 3, 4), SamplerOptions(cosine_abar(), "ddim", 5, eta=1.0)
    >>> torch.equal(sample(lambda x_t, t: x_0, x_0.shape, options), x_0)
    True
    """
    how, eta = options.sampler, options.eta
    abar = options.abar.detach().cpu()  # read as numbers: no wait for a GPU at every step
    times = sampling_times(how, options.steps, abar, options.sigma_min)
    x = _first(x_T, tuple(shape), generator).to(options.abar.device)
    if pin is not None:
        x = pin.start(x)
    before: tuple[Tensor, int] | None = None
    for i, (t, t_next) in enumerate(pairwise(times)):
        guess = _like(x, denoise(x, t), "denoise")
        x0_hat = _hooked(_cut(guess, options.clamp), hooks, abar_at(abar, t))
        if how == "ddpm":
            x = ddpm_step(x, x0_hat, t, abar, generator=generator)
        elif how == "dpm":
            x = dpm_step(x, x0_hat, t, t_next, abar, before=before, eta=eta, generator=generator)
        else:
            step = ddim_step if how == "ddim" else partial(own_step, how)
            x = step(x, x0_hat, t, t_next, abar, eta=eta, generator=generator)
        if pin is not None:
            x = pin(x, t_next)
        before = (x0_hat, t)
        if callback is not None:
            callback(i, len(times) - 1, x0_hat)
    return x
