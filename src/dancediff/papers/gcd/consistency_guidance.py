r"""Consistency guidance: gamma turns from varied over as learned to in step.

Read first: Le et al. 2023 (GCD) section 3.4 · `dancediff.papers.gcd.consistency_critic`.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_t     noisy motion, normalised             (b, n, f, d)
    x_hat   the guess of the clean motion        (b, n, f, d)
    gamma   $\gamma$   above 0: in step · 0: as learned · below 0: varied
"""

from collections.abc import Callable, Sequence
from itertools import pairwise

import torch
from torch import Tensor

from dancediff.diffusion.schedule import abar_at


def consistency_guided(
    denoise: Callable[[Tensor, int], Tensor],
    score: Callable[[Tensor, int], Tensor],
    gamma: float,
    abar: Tensor,
    times: Sequence[int],
) -> Callable[[Tensor, int], Tensor]:
    r"""Move every guess along the critic's gradient, in the step from t to t'.

    $$\hat x' = \hat x + \gamma\,\frac{1 - \bar\alpha_{t'}}{\sqrt{\bar\alpha_{t'}}}\,
      \nabla_{x_t} f(x_t, w, t)$$

    In DDPM's step this adds $\gamma\,\Sigma_t \nabla f$ to the mean, as the paper has it; in terms
    of the guess it serves every sampler (Dhariwal and Nichol 2021, alg. 2). The level is that which
    the step leads to: with that which it comes from, the first of few steps, whose factor is
    20,000, threw dancers metres apart. The last step, to clean, moves nothing. Since f is the log
    of a ratio of likelihoods, gamma = 1 samples groups by that ratio.

    Source: GCD section 3.4, whose gamma goes from -1 to 1.  Differs: the paper does not say how its
    gamma is scaled.

    ``times``: where the sampler stops, from noise down to -1.
    Shapes: denoise(x_t, t) -> x_hat like x_t; score(x_t, t) -> (b,).

    >>> abar, x = torch.tensor([0.5, 0.1]), torch.ones(1, 1, 1, 1)
    >>> def score(x, t):
    ...     return -0.5 * x.square().flatten(1).sum(1)
    >>> towards = consistency_guided(lambda x, t: x, score, 1, abar, times=[1, 0, -1])
    >>> round(towards(x, 1).item(), 4), towards(x, 0).item()            # 1 - 0.5 / sqrt(0.5)
    (0.2929, 1.0)
    """
    if gamma == 0:
        return denoise
    following = dict(pairwise(times))

    def moved(x_t: Tensor, t: int) -> Tensor:
        a = abar_at(abar, following[t])
        return denoise(x_t, t) + gamma * (1 - a) / a**0.5 * _gradient(score, x_t, t)

    return moved


def _gradient(score: Callable[[Tensor, int], Tensor], x_t: Tensor, t: int) -> Tensor:
    """Of the score at x_t, also where nothing else needs one."""
    with torch.inference_mode(False), torch.enable_grad():
        x = x_t.clone().requires_grad_()
        (gradient,) = torch.autograd.grad(score(x, t).sum(), x)
    return gradient
