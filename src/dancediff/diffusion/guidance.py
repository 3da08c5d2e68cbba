r"""Classifier-free guidance: exaggerate what the music changes in a guess.

Read first: notebook 06 · Ho and Salimans 2022 eq. 6 · EDGE section 3.3.

Symbols (axes: b batch · n dancers · f frames · d motion features · m music features)
    w     guidance weight     0: music ignored · 1: plain conditional · 2: the papers' code
"""

from collections.abc import Callable

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions


def guided(
    denoise: Callable[[Tensor, Tensor, Conditions], Tensor],
    conditions: Conditions,
    guidance: float | Callable[[int], float],
) -> Callable[[Tensor, int], Tensor]:
    r"""Bind a network to its conditions and exaggerate what the music changes.

    $$\hat x_0 = \hat x_0^\varnothing + w\,(\hat x_0^M - \hat x_0^\varnothing)$$

    With and without music run as one batch of 2 b. For w = 1 or w = 0 one of the two terms drops
    out and only the other is computed. ``guidance`` may be a function of the step t.

    Source: Ho and Salimans 2022, eq. 6, in terms of x_0; its w is ours less 1. EDGE and the code of
    TCDiff++ and Lodge take 2; the two papers name no guidance.  Differs: the official code runs the
    network twice in a row, for every w but 1.

    Shapes: denoise(x_t (b, ..., f, d), t (b,), conditions) -> x0_hat like x_t, as of a
    `dancediff.diffusion.conditions.Denoiser`; the result is a function of x_t and t: int.
    Raises: ValueError for a negative weight.

    >>> denoise = lambda x_t, t, conditions: x_t + conditions.music_mask[:, None, None]
    >>> conditions = Conditions(torch.zeros(1, 4, 35))
    >>> guided(denoise, conditions, guidance=3.0)(torch.zeros(1, 4, 1), t=10).unique().tolist()
    [3.0]
    """
    weight = guidance if callable(guidance) else lambda t: guidance
    repeated = {}  # the conditions, as many times as they are asked for: always the same tensors

    def run(x_t: Tensor, t: int, with_music: list[bool]) -> Tensor:  # one entry a copy
        b, copies = len(x_t), len(with_music)
        if copies not in repeated:
            repeated[copies] = conditions.repeat(copies)
        steps = torch.full((b * copies,), t, dtype=torch.long, device=x_t.device)
        mask = torch.cat([torch.full((b,), m, device=x_t.device) for m in with_music])
        x_t = x_t if copies == 1 else torch.cat([x_t] * copies)
        return denoise(x_t, steps, repeated[copies].with_mask(mask))

    def denoise_guided(x_t: Tensor, t: int) -> Tensor:
        w = weight(t)
        if not w >= 0:
            raise ValueError(f"guidance={w} at t={t} must be at least 0; 1 switches it off")
        if w in (0, 1):
            return run(x_t, t, [w == 1])
        conditional, unconditional = run(x_t, t, [True, False]).chunk(2)
        return unconditional + w * (conditional - unconditional)

    return denoise_guided


def off_at_the_end(guidance: float, num_steps: int = 1000) -> Callable[[int], float]:
    r"""EDGE's weight for DDPM: no exaggeration in the last tenth, where details are set.

    $$w(t) = \min(w, 1)\ \text{ for } t < T/10, \quad w \text{ before}$$

    Source: EDGE's code; the papers do not mention it.

    >>> w = off_at_the_end(2.0)
    >>> w(999), w(100), w(99)
    (2.0, 2.0, 1.0)
    """
    return lambda t: min(guidance, 1.0) if t < num_steps / 10 else guidance


def ramp_up(guidance: float, times: list[int]) -> Callable[[int], float]:
    r"""EDGE's weight for long DDIM: from 0 to ``guidance`` over the first half of the steps.

    $$w_k = \min\big(w,\ 2 w k / (K - 1)\big), \quad k = 0 \dots K - 1$$

    Source: EDGE's code (also Lodge's). TCDiff++'s long sampling keeps w constant.

    ``times`` is what `dancediff.diffusion.ddim.ddim_times` returned: K + 1 steps.

    >>> w = ramp_up(2.0, [999, 749, 499, 249, -1])
    >>> [round(w(t), 3) for t in (999, 749, 499, 249)]
    [0.0, 1.333, 2.0, 2.0]
    """
    last = max(len(times) - 2, 1)
    weights = {t: min(guidance, 2 * guidance * k / last) for k, t in enumerate(times[:-1])}
    return weights.__getitem__
