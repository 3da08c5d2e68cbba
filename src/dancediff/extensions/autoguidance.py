r"""Autoguidance: push guesses away from those of a worse model, the best linear one.

Read first: notebook 06 · Karras et al. 2024, "Guiding a Diffusion Model with a Bad Version of
Itself" · Kynkäänniemi et al. 2024, "Applying Guidance in a Limited Interval Improves Sample and
Distribution Quality in Diffusion Models" · `dancediff.extensions.preconditioning`.

A network that has not learned all there is to know stays too near to the best guess without
knowledge of dance, and its dances too near to the mean. What it does know is exaggerated here.
The linear guess costs nothing. Under little noise large movements are settled and a push moves
feet that stand, so it can end before: `last_pushed`.

Symbols (axes: f frames · d motion features)
    x_t     noisy motion             (..., f, d)
    abar    $\bar\alpha_t$           (T,)          signal power left at step t
    w       weight of the push       float
"""

from collections.abc import Callable

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.motion.representation import TCDIFFPP

ROOT_SHARE = 0.7  # of models of groups and EDGE: pushed as far as joints, dancers run
LASTING_SHARE = 0.65  # of them: pushed as far as movements, poses that last are grotesque


def autoguided(
    denoise: Callable[[Tensor, int], Tensor],
    linear: Callable[[Tensor, int], Tensor],
    weight: float,
    *,
    root_share: float = 1.0,
    lasting_share: float = 1.0,
    last: int = 0,
) -> Callable[[Tensor, int], Tensor]:
    r"""Push every guess of a denoiser away from the linear one.

    $$\hat x_0 \leftarrow \hat x_0 + (w - 1)\,\big(d - (1 - \text{lasting})\,\overline{d}\big),
      \quad d = \hat x_0 - \hat x_0^{lin}$$

    The mean $\overline d$ over the frames is what lasts: with a ``lasting_share`` below 1,
    movements are pushed further than the pose that they are about. The root gets ``root_share``
    of the weight. At steps t below ``last`` guesses are taken as they are: see `last_pushed`.

    Shapes: denoise, linear (x_t, t) -> x0_hat (..., f, d); the result is such a function, too.
    Raises: ValueError for a weight below 1, which would smooth instead.

    >>> push = autoguided(lambda x_t, t: x_t + 2, lambda x_t, t: x_t, 1.5)
    >>> push(torch.zeros(1, 151), 10).unique().item()
    3.0
    """
    if not weight >= 1:
        raise ValueError(f"autoguidance={weight} must be at least 1; 1 switches it off")
    if weight == 1:
        return denoise

    def pushed(x_t: Tensor, t: int) -> Tensor:
        guess = denoise(x_t, t)
        if t < last:
            return guess
        d = guess - linear(x_t, t)
        w = guess.new_full(guess.shape[-1:], weight)
        w[TCDIFFPP.root] = 1 + root_share * (weight - 1)
        return guess + (w - 1) * (d - (1 - lasting_share) * d.mean(-2, keepdim=True))

    return pushed


def last_pushed(abar: Tensor, end: float) -> int:
    r"""The least t whose noise is at least ``end``, as a share of the signal.

    $$t_{last} = \min \Big\{ t : \sqrt{(1 - \bar\alpha_t) / \bar\alpha_t} \ge \text{end} \Big\}$$

    Source: Kynkäänniemi et al. 2024, who leave out the most noise as well.

    >>> last_pushed(torch.tensor([0.99, 0.9, 0.5, 0.1]), 0.3), last_pushed(torch.ones(4), 0.0)
    (1, 0)
    """
    return int((((1 - abar) / abar).sqrt() < end).sum())


def linear_guess_of(model, conditions: Conditions) -> Callable[[Tensor, int], Tensor]:
    """A network's best linear guess for these conditions, a function of x_t and t."""

    def linear(x_t: Tensor, t: int) -> Tensor:
        steps = torch.full((len(x_t),), t, dtype=torch.long, device=x_t.device)
        return model.linear_guess(x_t, steps, conditions)

    return linear
