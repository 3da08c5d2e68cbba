r"""Pinning: keep the first frames of a window equal to a context while the rest is sampled.

Read first: notebook 10 · Lugmayr et al. 2022 (RePaint) eq. 8 · TCDiff++ section 4.4, eq. 19.

Symbols (axes: b batch · n dancers · f frames · k frames of context · d motion features)
    context  the first k frames, clean and normalised   (b, n, k, d)
    t_next   the step the sampler has just reached; -1 is clean
"""

from dataclasses import dataclass, field
from typing import Protocol

import torch
from torch import Tensor

from dancediff.diffusion.schedule import Generators, gaussian, q_sample

MODES = ("same_noise", "renoise", "clean", "init")
NOISY_CONTEXT = ("same_noise", "renoise")  # modes: the context has the noise level of the rest


class Pin(Protocol):
    """What keeps a part of a dance fixed while the rest is sampled; `Pinning` is one."""

    def start(self, x_T: Tensor) -> Tensor:
        """The first input with that part in it."""
        ...

    def __call__(self, x_next: Tensor, t_next: int) -> Tensor:
        """The same for an input that the sampler has just brought to step t_next."""
        ...


@dataclass
class Pinning:
    r"""Keep the first k frames of a window equal to the context while the rest is sampled.

    $$x_{t'}^{[0:k]} \leftarrow \sqrt{\bar\alpha_{t'}}\,\text{context}
      + \sqrt{1 - \bar\alpha_{t'}}\;\epsilon$$

    ============  ============================================  ==================================
    mode          after every step, the context is              which is
    ============  ============================================  ==================================
    "same_noise"  at the noise level of the rest, under the     where a deterministic sampler
                  noise of the first input                      would have them
    "renoise"     at the noise level of the rest, under fresh   RePaint; for samplers that add
                  noise                                         noise (eta = 1)
    "clean"       clean, at every noise level                   the released TCDiff++
    "init"        left alone; only the first input holds them   the paper, eq. 19
    ============  ============================================  ==================================

    With eta = 0 the noise of a frame never changes on its way to clean. Fresh noise on half of the
    frames at every step is what no network was trained on: joined segment after segment, dances
    lose their turns and stretch out their arms (docs/drift.md).

    In "init" the context enters the first input with weight 4.9e-5: it is the noise that has
    to carry it over, so hand the noise that made the context to `start`. With eta = 1 fresh noise
    replaces it in every step, and nothing is carried over: then segments are tied by the order of
    the dancers, their swap mode and the seam alone.

    Replacing frames is not enough for a smooth seam: free frames follow the guess, and the guess
    for the context is never quite right. `dancediff.extensions.initial_frames` mends that.

    The first input is noised to the strongest level whatever the sampler's first one is: to a
    signal of 4.9e-5, where DPM-Solver++ begins at 0.011. From the second guess on both are alike.

    The last guess is left alone, as in the released code: whoever joins the segments decides what
    becomes of the context.

    Shapes: context (b, n, k, d), abar (T,).
    Raises: ValueError for an unknown mode.

    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> pin = Pinning(torch.ones(1, 1, 2, 1), cosine_abar(), mode="clean")
    >>> pin(torch.zeros(1, 1, 4, 1), t_next=10).flatten().tolist()
    [1.0, 1.0, 0.0, 0.0]
    """

    context: Tensor
    abar: Tensor
    mode: str = "same_noise"
    generator: Generators = None
    noise: Tensor | None = field(default=None, init=False)  # of the context, set by `start`

    def __post_init__(self):
        if self.mode not in MODES:
            raise ValueError(f"mode={self.mode!r} is not one of {', '.join(map(repr, MODES))}")

    def start(self, x_T: Tensor) -> Tensor:
        """Put the context under the noise that x_T (b, n, f, d) already has there."""
        self.noise = x_T[:, :, : self.context.shape[2]]
        noisy = q_sample(self.context, len(self.abar) - 1, self.abar, self.noise)
        return self._replace(x_T, noisy)

    def __call__(self, x_next: Tensor, t_next: int) -> Tensor:
        """Pin x_next (b, n, f, d), which the sampler has just brought to step t_next."""
        if self.mode == "init" or t_next == -1:
            return x_next
        if self.mode == "clean":
            return self._replace(x_next, self.context)
        if self.mode == "same_noise":
            if self.noise is None:
                raise ValueError("mode='same_noise' needs the noise of the first input: call start")
            eps = self.noise
        else:
            shape, device = self.context.shape, x_next.device
            eps = gaussian(shape, generator=self.generator, device=device, dtype=x_next.dtype)
        return self._replace(x_next, q_sample(self.context, t_next, self.abar, eps))

    def _replace(self, x: Tensor, start: Tensor) -> Tensor:
        b, n, k, d = start.shape
        if x.shape[:2] != (b, n) or x.shape[3] != d or x.shape[2] < k:
            raise ValueError(
                f"context {tuple(start.shape)} does not fit at the start of x {tuple(x.shape)}; "
                "both are (b, n, f, d) and x must be at least as long"
            )
        return torch.cat([start.to(x), x[:, :, k:]], dim=2)
