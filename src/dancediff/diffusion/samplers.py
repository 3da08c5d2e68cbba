r"""Samplers: from noise to a dance, one step at a time.

Read first: notebook 06 · Ho et al. 2020 (DDPM) eq. 6-7 · Song et al. 2021 (DDIM) eq. 12 ·
Lu et al. 2022 (DPM-Solver++) algorithm 2.

Symbols (axes: b batch · n dancers · f frames · d motion features; t is ALWAYS the diffusion step)
    x_t     noisy motion            (b, n, f, d)
    x0_hat  the network's guess     (b, n, f, d)      $\hat x_0$: we predict x_0, not the noise
    abar    $\bar\alpha_t$          (T,)              signal power left at step t
    eta     $\eta$                  float in [0, 1]   0 = deterministic, 1 = as noisy as DDPM

The steps are pure functions that never see a network; `sample` is the loop around them.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Protocol

import torch
from torch import Tensor

from dancediff.diffusion.pinning import Pin
from dancediff.diffusion.schedule import Generators, abar_at, cosine_abar, gaussian, send
from dancediff.own import is_own, own_function


class GuessHook(Protocol):
    """Changes every guess of a sampler before the next step is made from it."""

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Another guess; x0_hat is on the CPU, ``abar`` the signal power at its step."""
        ...


SAMPLERS = ("dpm", "ddim", "ddpm")
LOUDEST = -4.5  # half log of signal over noise, where "dpm" begins: 0.01 % of the power is signal


def ddim_times(steps: int, num_steps: int = 1000) -> list[int]:
    r"""Evenly spaced steps from T - 1 down to -1 ("clean"), both ends included.

    $$t_k = \lfloor k\,T / K \rfloor - 1, \quad k = K, \dots, 0$$

    Source: EDGE's truncated linspace, here in integers so that rounding cannot repeat a step.

    Raises: ValueError unless 1 <= steps <= num_steps.

    >>> ddim_times(4)
    [999, 749, 499, 249, -1]
    """
    if not 1 <= steps <= num_steps:
        raise ValueError(f"steps={steps} must lie in 1 ... {num_steps}, the schedule's length")
    return [k * num_steps // steps - 1 for k in range(steps, -1, -1)]


def ddim_step(
    x_t: Tensor,
    x0_hat: Tensor,
    t: int,
    t_next: int,
    abar: Tensor,
    *,
    eta: float,
    generator: Generators = None,
) -> Tensor:
    r"""One reverse step $x_t \to x_{t'}$ with $t' = $ ``t_next`` ($-1$ means "clean").

    $$x_{t'} = \sqrt{\bar\alpha_{t'}}\,\hat x_0
      + \sqrt{1 - \bar\alpha_{t'} - \sigma^2}\;\hat\epsilon + \sigma z, \quad
      \sigma^2 = \eta^2\,\frac{1 - \bar\alpha_{t'}}{1 - \bar\alpha_t}
      \Big(1 - \frac{\bar\alpha_t}{\bar\alpha_{t'}}\Big)$$

    where $\hat\epsilon = (x_t - \sqrt{\bar\alpha_t}\,\hat x_0) / \sqrt{1 - \bar\alpha_t}$ is the
    noise that would explain x_t if the guess were right.

    Source: DDIM eq. 12 and 16.  Differs: EDGE, TCDiff++ and Lodge fuse the step with the loop.

    Shapes: x_t, x0_hat (b, n, f, d); abar (T,) -> (b, n, f, d).  Units: normalised features.
    Raises: ValueError unless t_next < t and 0 <= eta <= 1.

    >>> abar = torch.linspace(0.99, 0.01, 10)
    >>> x0 = torch.ones(1, 2, 3, 4)
    >>> torch.equal(ddim_step(torch.randn_like(x0), x0, t=5, t_next=-1, abar=abar, eta=0), x0)
    True
    """
    _check_step(t, t_next, eta)
    if t_next == -1:
        return x0_hat
    a, a_next = abar_at(abar, t), abar_at(abar, t_next)
    eps_hat = (x_t - math.sqrt(a) * x0_hat) / math.sqrt(1 - a)
    sigma = eta * math.sqrt((1 - a_next) / (1 - a) * (1 - a / a_next))
    direction = math.sqrt(max(1 - a_next - sigma**2, 0.0))  # below 0 only by rounding
    x_next = math.sqrt(a_next) * x0_hat + direction * eps_hat
    return x_next + _noise(sigma, x_t, generator)


def half_logsnr(abar: Tensor, t: int) -> float:
    r"""How much signal there is for the noise; infinite for the clean dance.

    $$\lambda_t = \tfrac12 \ln \frac{\bar\alpha_t}{1 - \bar\alpha_t}$$

    >>> half_logsnr(torch.tensor([0.5]), 0), half_logsnr(torch.tensor([0.5]), -1)
    (0.0, inf)
    """
    a = abar_at(abar, t)
    return math.inf if a == 1 else 0.5 * math.log(a / (1 - a))


def logsnr_times(steps: int, abar: Tensor, sigma_min: float = 0.0) -> list[int]:
    r"""Steps evenly spaced in $\lambda$, then -1 ("clean"): every size of motion gets as many.

    What a dance is made of becomes visible one size after the other, formations first, trembling
    last. Steps that are even in t hurry through both ends.

    - ``sigma_min``: noise, as a share of the signal, at which the last guess is taken; 0 for the
      least of the schedule. What a network's guesses under little noise are worth differs:
      ``benchmarks/few_steps.py`` measures it.

    Source: DPM-Solver++ section 5.  Differs: begins at `LOUDEST`, since the cosine schedule's first
    step alone is a quarter of its way; steps that fall on the same t are taken once.

    Raises: ValueError unless 1 <= steps <= len(abar) and 0 <= sigma_min <= 1.

    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> logsnr_times(6, cosine_abar())
    [992, 951, 698, 174, 20, 0, -1]
    >>> logsnr_times(6, cosine_abar(), sigma_min=0.16)
    [992, 974, 910, 703, 322, 93, -1]
    """
    if not 1 <= steps <= len(abar):
        raise ValueError(f"steps={steps} must lie in 1 ... {len(abar)}, the schedule's length")
    if not 0 <= sigma_min <= 1:
        raise ValueError(f"sigma_min={sigma_min} must lie in 0 ... 1, noise over signal")
    level = 0.5 * torch.log(abar / (1 - abar))
    end = min(-math.log(sigma_min), float(level[0])) if sigma_min else float(level[0])
    wanted = torch.linspace(max(LOUDEST, float(level[-1])), end, steps)
    times = [int((level - value).abs().argmin()) for value in wanted]
    return [*dict.fromkeys(times), -1]


def dpm_step(
    x_t: Tensor,
    x0_hat: Tensor,
    t: int,
    t_next: int,
    abar: Tensor,
    *,
    before: tuple[Tensor, int] | None = None,
    eta: float,
    generator: Generators = None,
) -> Tensor:
    r"""One step of DPM-Solver++(2M): the guess is continued along a line through the last two.

    $$x_{t'} = \frac{\sigma_{t'}}{\sigma_t}\,e^{-\eta h}\,x_t
      + \alpha_{t'}\,(1 - e^{-(1 + \eta) h})\,D + \sigma_{t'} \sqrt{1 - e^{-2\eta h}}\;z, \qquad
      D = \hat x_0 + \frac{h}{2 h_-}\,(\hat x_0 - \hat x_0^-)$$

    with $h = \lambda_{t'} - \lambda_t$, $\alpha = \sqrt{\bar\alpha}$,
    $\sigma = \sqrt{1 - \bar\alpha}$. DDIM takes D to be the guess; so every step falls short of
    what the guess will be at its end, and with few of them formations shrink and jumps get blunt.

    - ``before``: the guess before and its step; without it D is the guess.
    - ``eta``: 0 follows the flow, 1 adds fresh noise at every step, as DDPM does.

    Source: DPM-Solver++ algorithm 2 (eta = 0) and appendix (SDE form, eta = 1).

    Shapes: x_t, x0_hat (b, n, f, d); abar (T,) -> (b, n, f, d).
    Raises: ValueError unless t_next < t and 0 <= eta <= 1.

    >>> abar = torch.linspace(0.99, 0.01, 10)
    >>> x_t, x0 = torch.randn(1, 2, 3, 4), torch.ones(1, 2, 3, 4)
    >>> first = dpm_step(x_t, x0, 9, 5, abar, eta=0)
    >>> torch.allclose(first, ddim_step(x_t, x0, 9, 5, abar, eta=0), atol=1e-6)
    True
    """
    _check_step(t, t_next, eta)
    if t_next == -1:
        return x0_hat
    a, a_next = abar_at(abar, t), abar_at(abar, t_next)
    h = half_logsnr(abar, t_next) - half_logsnr(abar, t)
    D = x0_hat
    if before is not None:
        last, t_last = before
        h_last = half_logsnr(abar, t) - half_logsnr(abar, t_last)
        D = x0_hat + h / (2 * h_last) * (x0_hat - last)
    keep = math.sqrt((1 - a_next) / (1 - a)) * math.exp(-eta * h)
    x_next = keep * x_t - math.sqrt(a_next) * math.expm1(-(1 + eta) * h) * D
    sigma = math.sqrt((1 - a_next) * -math.expm1(-2 * eta * h))
    return x_next + _noise(sigma, x_t, generator)


def ddpm_step(
    x_t: Tensor,
    x0_hat: Tensor,
    t: int,
    abar: Tensor,
    *,
    generator: Generators = None,
) -> Tensor:
    r"""One step $x_t \to x_{t-1}$, drawn from the posterior $q(x_{t-1} \mid x_t, \hat x_0)$.

    $$x_{t-1} = \frac{\sqrt{\bar\alpha_{t-1}}\,\beta_t}{1 - \bar\alpha_t}\,\hat x_0
      + \frac{\sqrt{\alpha_t}\,(1 - \bar\alpha_{t-1})}{1 - \bar\alpha_t}\,x_t + \sigma z, \quad
      \sigma^2 = \frac{1 - \bar\alpha_{t-1}}{1 - \bar\alpha_t}\,\beta_t$$

    with $\alpha_t = \bar\alpha_t / \bar\alpha_{t-1}$ and $\beta_t = 1 - \alpha_t$.

    Source: DDPM eq. 6 and 7; TCDiff++ eq. 2.

    Shapes: x_t, x0_hat (b, n, f, d); abar (T,) -> (b, n, f, d).  At t = 0 it returns x0_hat.

    >>> x0 = torch.ones(1, 2, 3, 4)
    >>> torch.equal(ddpm_step(torch.randn_like(x0), x0, t=0, abar=torch.tensor([0.99])), x0)
    True
    """
    if t == 0:
        return x0_hat
    a, a_next = abar_at(abar, t), abar_at(abar, t - 1)
    alpha = a / a_next
    beta = 1 - alpha
    mean = (
        math.sqrt(a_next) * beta / (1 - a) * x0_hat
        + math.sqrt(alpha) * (1 - a_next) / (1 - a) * x_t
    )
    return mean + _noise(math.sqrt((1 - a_next) / (1 - a) * beta), x_t, generator)


def own_step(name: str, x_t: Tensor, *where, **how) -> Tensor:
    """A step of a sampler of the user's own, "module:function".

    Raises: ValueError when it cannot be called like that, or returns another shape than x_t's.
    """
    try:
        x = own_function(name, "sampler")(x_t, *where, **how)
    except TypeError as err:
        raise ValueError(f"sampler={name!r}: {err}; it is called as ddim_step is") from err
    if not isinstance(x, Tensor) or x.shape != x_t.shape:
        what = tuple(x.shape) if isinstance(x, Tensor) else type(x).__name__
        raise ValueError(
            f"sampler={name!r} returned {what}; it must be like x_t {tuple(x_t.shape)}"
        )
    return x


def _check_step(t: int, t_next: int, eta: float) -> None:
    if not t_next < t:
        raise ValueError(f"t_next={t_next} must be below t={t}: sampling goes towards -1")
    if not 0 <= eta <= 1:
        raise ValueError(f"eta={eta} must lie in 0 (deterministic) ... 1 (as noisy as DDPM)")


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


def _noise(sigma: float, like: Tensor, generator: Generators) -> Tensor | float:
    """Draw sigma z; a sampler without noise leaves the generator untouched."""
    if sigma == 0:
        return 0.0
    return sigma * gaussian(like.shape, generator=generator, device=like.device, dtype=like.dtype)


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

    Source: EDGE, TCDiff++ and Lodge all use T = 1000, 50 DDIM steps, eta = 1, x0_hat cut at +-1.

    - ``generator``: one for all noise, or a list of one for each row of the batch, so that rows are
      the same whatever others are sampled with them.
    - ``pin``: holds the first frames at known motion (`dancediff.diffusion.pinning.Pinning`).
    - ``hooks`` change every guess, one after the other, on the CPU: their tensors are small, and a
      GPU would have to be waited for at every branch.
    - ``callback(i, total, x0_hat)`` runs after step i, to draw pictures or a progress bar.

    Shapes: shape = (b, n, f, d); x_T like it, or None to draw it -> x_0 (b, n, f, d).
    Raises: ValueError for an unknown sampler, or steps, eta or x_T out of range.

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
        x0_hat = _hooked(_cut(denoise(x, t), options.clamp), hooks, abar_at(abar, t))
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
