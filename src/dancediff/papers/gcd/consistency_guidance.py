r"""Consistency guidance: gamma turns from varied over as learned to in step.

Read first: Le et al. 2023 (GCD) section 3.4 · `dancediff.papers.gcd.consistency_critic`.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_t     noisy motion, normalised             (b, n, f, d)
    x_hat   the guess of the clean motion        (b, n, f, d)
    gamma   $\gamma$   above 0: in step · 0: as learned · below 0: varied
"""

from collections.abc import Callable

import torch
from torch import Tensor

from dancediff.diffusion.schedule import abar_at


def dialled(
    denoise: Callable[[Tensor, int], Tensor],
    score: Callable[[Tensor, int], Tensor],
    gamma: float,
    abar: Tensor,
) -> Callable[[Tensor, int], Tensor]:
    r"""Move every guess along the critic's gradient.

    $$\hat x' = \hat x + \gamma\,\frac{1 - \bar\alpha_t}{\sqrt{\bar\alpha_t}}\,
      \nabla_{x_t} f(x_t, w, t)$$

    In DDPM's step of small beta this adds $\gamma\,\Sigma_t \nabla f$ to the mean, as the paper
    has it; in terms of the guess it serves every sampler (Dhariwal and Nichol 2021, alg. 2). Since
    f is the log of a ratio of likelihoods, gamma = 1 samples groups by that ratio.

    Source: GCD section 3.4, whose gamma goes from -1 to 1.  Differs: the paper does not say how its
    gamma is scaled.

    Shapes: denoise(x_t, t) -> x_hat like x_t; score(x_t, t) -> (b,).

    >>> abar = torch.tensor([0.5])
    >>> towards = dialled(lambda x, t: x, lambda x, t: -0.5 * x.square().flatten(1).sum(1), 1, abar)
    >>> round(towards(torch.ones(1, 1, 1, 1), 0).item(), 4)             # 1 - 0.5 / sqrt(0.5)
    0.2929
    """
    if gamma == 0:
        return denoise

    def moved(x_t: Tensor, t: int) -> Tensor:
        a = abar_at(abar, t)
        return denoise(x_t, t) + gamma * (1 - a) / a**0.5 * _gradient(score, x_t, t)

    return moved


def _gradient(score: Callable[[Tensor, int], Tensor], x_t: Tensor, t: int) -> Tensor:
    """Of the score at x_t, also where nothing else needs one."""
    with torch.inference_mode(False), torch.enable_grad():
        x = x_t.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(score(x, t).sum(), x)
    return gradient
