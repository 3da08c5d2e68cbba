r"""All segments of a dance sampled as one batch, as in naive long sampling, GCD and TCDiff.

Read first: `dancediff.papers.edge.naive_long_sampling` · `dancediff.diffusion.samplers`.

Symbols (axes: k segments · n dancers · f frames of a segment · d motion features)
"""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.pinning import Pin
from dancediff.diffusion.samplers import GuessHook, SamplerOptions, sample
from dancediff.generation.guided_denoiser import Denoise

AT_ONCE = 8  # segments that go through the network together: memory of a dance of 20 s


def in_parts(bind: Callable[[Conditions], Denoise], conditions: Conditions) -> Denoise:
    """The guesses for all segments, `AT_ONCE` of them at a time.

    >>> bind = lambda conditions: lambda x_t, t: x_t + len(conditions)
    >>> conditions = Conditions(torch.zeros(11, 5, 35))
    >>> in_parts(bind, conditions)(torch.zeros(11, 1), 0).flatten().tolist()[6:10]
    [8.0, 8.0, 3.0, 3.0]
    """
    rows = [slice(i, i + AT_ONCE) for i in range(0, len(conditions), AT_ONCE)]
    parts = [bind(conditions.rows(some)) for some in rows]

    def denoise(x_t: Tensor, t: int) -> Tensor:
        pairs = zip(parts, x_t.split(AT_ONCE), strict=True)
        return torch.cat([part(x, t) for part, x in pairs])

    return denoise


def sample_all(
    denoise: Denoise,
    shape: tuple[int, ...],
    options: SamplerOptions,
    *,
    generator: torch.Generator,
    hooks: Sequence[GuessHook],
    pin: Pin | None = None,
    report: Callable[[int, int], None] | None = None,
) -> Tensor:
    """Sample segments together; ``report(done, total)`` is called after every step.

    Shapes: shape (k, n, f, d) -> the same, normalised.
    """

    def callback(i: int, total: int, x0_hat: Tensor) -> None:
        if report is not None:
            report(i + 1, total)

    return sample(
        denoise, shape, options, generator=generator, pin=pin, hooks=hooks, callback=callback
    )
