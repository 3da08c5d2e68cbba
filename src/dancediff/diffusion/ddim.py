r"""DDIM: any number of steps, with as much fresh noise as one likes.

Read first: notebook 06 · Song et al. 2021 (DDIM) eq. 12 and 16.

Symbols (axes: b batch · n dancers · f frames · d motion features; t is ALWAYS the noise level)
    x_t     noisy motion            (b, n, f, d)
    x0_hat  the network's guess     (b, n, f, d)      $\hat x_0$: we predict x_0, not the noise
    abar    $\bar\alpha_t$          (T,)              signal power left at step t
    eta     $\eta$                  float in [0, 1]   0 = deterministic, 1 = as noisy as DDPM
"""

import math

from torch import Tensor

from dancediff.diffusion.schedule import Generators, abar_at, check_step, scaled_noise


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

    >>> import torch
    >>> abar = torch.linspace(0.99, 0.01, 10)
    >>> x0 = torch.ones(1, 2, 3, 4)
    >>> torch.equal(ddim_step(torch.randn_like(x0), x0, t=5, t_next=-1, abar=abar, eta=0), x0)
    True
    """
    check_step(t, t_next, eta)
    if t_next == -1:
        return x0_hat
    a, a_next = abar_at(abar, t), abar_at(abar, t_next)
    eps_hat = (x_t - math.sqrt(a) * x0_hat) / math.sqrt(1 - a)
    sigma = eta * math.sqrt((1 - a_next) / (1 - a) * (1 - a / a_next))
    direction = math.sqrt(max(1 - a_next - sigma**2, 0.0))  # below 0 only by rounding
    x_next = math.sqrt(a_next) * x0_hat + direction * eps_hat
    return x_next + scaled_noise(sigma, x_t, generator)
