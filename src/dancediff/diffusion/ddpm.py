r"""DDPM: one step back in time, drawn from the posterior of the forward process.

Read first: notebook 06 · Ho et al. 2020 (DDPM) eq. 6-7.

Symbols (axes: b batch · n dancers · f frames · d motion features; t is ALWAYS the noise level)
    x_t     noisy motion            (b, n, f, d)
    x0_hat  the network's guess     (b, n, f, d)      $\hat x_0$: we predict x_0, not the noise
    abar    $\bar\alpha_t$          (T,)              signal power left at step t
"""

import math

from torch import Tensor

from dancediff.diffusion.schedule import Generators, abar_at, scaled_noise


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

    >>> import torch
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
    return mean + scaled_noise(math.sqrt((1 - a_next) / (1 - a) * beta), x_t, generator)
