r"""Gaussian start: while noise is loud, the linear guess takes the place of the network's.

Read first: notebook 06 · `dancediff.extensions.preconditioning` · Wang and Vastola 2024, "The
Unreasonable Effectiveness of Gaussian Score Approximation for Diffusion Models".

`dancediff.diffusion.samplers.LOUDEST` spares a network the first steps of "dpm". But the noise that
is drawn there shows nothing of a dance, and x_t of a real one shows a little: where it stands on
the stage. Sampling takes that for news, and groups end up a tenth to a quarter too close. From
T - 1 on there is no such error, and what a network could say there a Gaussian says as well.
"""

from collections.abc import Callable

from torch import Tensor

from dancediff.diffusion.samplers import gaussian_end


def started_by_gaussian(
    denoise: Callable[[Tensor, int], Tensor], linear: Callable[[Tensor, int], Tensor], abar: Tensor
) -> Callable[[Tensor, int], Tensor]:
    r"""A denoiser whose guesses under loud noise are linear.

    $$\hat x_0 = \begin{cases} \hat x_0^{lin} & t > t_\text{end} \\
      \hat x_0^{net} & \text{else} \end{cases}$$

    Source: the "analytical teleportation" of Wang and Vastola 2024.  Differs: a few steps of the
    sampler instead of one exact one, so that what is pinned or fixed is heeded.

    Shapes: denoise, linear (x_t, t) -> x0_hat; the result is such a function, too. abar (T,).

    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> guess = started_by_gaussian(lambda x_t, t: "net", lambda x_t, t: "linear", cosine_abar())
    >>> guess(None, 999), guess(None, 967), guess(None, 0)
    ('linear', 'net', 'net')
    """
    end = gaussian_end(abar.detach().cpu())
    return lambda x_t, t: (linear if t > end else denoise)(x_t, t)
