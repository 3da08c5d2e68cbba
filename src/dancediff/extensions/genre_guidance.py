r"""Genre guidance: exaggerate what the genre changes, and leave the music as it was learned.

Read first: `dancediff.diffusion.guidance` · `dancediff.extensions.genre_condition` · Liu et al.
2022, "Compositional Visual Generation with Composable Diffusion Models".

Symbols
    M    the music, in both guesses
    g    the genre that is asked for; ∅ none
    w    weight     1: as learned · more: farther from a dance of no genre
"""

from collections.abc import Callable
from dataclasses import replace

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions

Bind = Callable[[Conditions], Callable[[Tensor, int], Tensor]]


def genre_guided(bind: Bind, conditions: Conditions, weight: float) -> Callable:
    r"""Bind a network to its conditions and exaggerate what the genre changes.

    $$\hat x_0 = \hat x_0^{M,\varnothing} + w\,(\hat x_0^{M,g} - \hat x_0^{M,\varnothing})$$

    Classifier-free guidance would exaggerate music and genre together. Both guesses are ones the
    network has learned to make: training hides the genre from some windows and leaves them their
    music. It costs a second guess; without a genre there is only the first.

    Source: ours; Liu et al. 2022 guide each condition by itself.

    Shapes: bind(conditions) -> denoise(x_t, t) -> x0_hat like x_t; the result is such a function.
    Raises: ValueError for a weight below 1, which would make genres alike.

    >>> bind = lambda conditions: lambda x_t, t: x_t + conditions.genre.sum()
    >>> jazz = Conditions(torch.zeros(1, 4, 35), genre=torch.tensor([[0.0, 1.0]]))
    >>> genre_guided(bind, jazz, weight=3)(torch.zeros(2), 10).tolist()
    [3.0, 3.0]
    """
    if not weight >= 1:
        raise ValueError(f"genre_guidance={weight} must be at least 1, which leaves it off")
    asked = bind(conditions)
    if conditions.genre is None:
        return asked
    any_genre = bind(replace(conditions, genre=torch.zeros_like(conditions.genre)))

    def denoise(x_t: Tensor, t: int) -> Tensor:
        without = any_genre(x_t, t)
        return without + weight * (asked(x_t, t) - without)

    return denoise
