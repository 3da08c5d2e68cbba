r"""DPM-Solver++(2M): each guess is continued along a line through the last two.

Read first: notebook 06 · Lu et al. 2022 (DPM-Solver++) algorithm 2.

Symbols (axes: b batch · n dancers · f frames · d motion features; t is ALWAYS the noise level)
    x_t     noisy motion            (b, n, f, d)
    x0_hat  the network's guess     (b, n, f, d)      $\hat x_0$: we predict x_0, not the noise
    abar    $\bar\alpha_t$          (T,)              signal power left at step t
    eta     $\eta$                  float in [0, 1]   0 = deterministic, 1 = as noisy as DDPM
    lambda  $\lambda_t$             float             half the log of signal over noise
"""

import math

import torch
from torch import Tensor

from dancediff.diffusion.schedule import Generators, abar_at, check_step, scaled_noise

FIRST_HALF_LOGSNR = -4.5  # half the log of signal over noise, where "dpm" begins: 0.01 % is signal


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

    Source: DPM-Solver++ section 5.  Differs: begins at `FIRST_HALF_LOGSNR`, since the
    cosine schedule's first step alone is a quarter of its way; steps that fall on the same t are
    taken once.

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
    wanted = torch.linspace(max(FIRST_HALF_LOGSNR, float(level[-1])), end, steps)
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

    >>> from dancediff.diffusion.ddim import ddim_step
    >>> abar = torch.linspace(0.99, 0.01, 10)
    >>> x_t, x0 = torch.randn(1, 2, 3, 4), torch.ones(1, 2, 3, 4)
    >>> first = dpm_step(x_t, x0, 9, 5, abar, eta=0)
    >>> torch.allclose(first, ddim_step(x_t, x0, 9, 5, abar, eta=0), atol=1e-6)
    True
    """
    check_step(t, t_next, eta)
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
    return x_next + scaled_noise(sigma, x_t, generator)
