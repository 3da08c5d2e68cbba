r"""Pinning: tell the sampler how the window starts, and let it dance on from there.

Read first: notebook 10 · Lugmayr et al. 2022 (RePaint) eq. 8 · TCDiff++ section 4.4, eq. 19.

Symbols (axes: b batch · n dancers · f frames · k known frames · d motion features)
    known    the first k frames, clean and normalised   (b, n, k, d)
    t_next   the step the sampler has just reached; -1 is clean
"""

from dataclasses import dataclass, field

import torch
from torch import Tensor

from dancediff.diffusion.schedule import gaussian, q_sample

MODES = ("same_noise", "renoise", "clean", "init")


@dataclass
class Pinning:
    r"""Hold the first k frames of a window at known motion while the rest is sampled.

    $$x_{t'}^{[0:k]} \leftarrow \sqrt{\bar\alpha_{t'}}\,\text{known}
      + \sqrt{1 - \bar\alpha_{t'}}\;\epsilon$$

    ============  ============================================  ==================================
    mode          after every step, the known frames are        which is
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

    In "init" the first input holds ``q_sample(known, t_star)``. With the paper's t_star = T - 1 the
    known motion enters with weight 4.9e-5: it is the noise that has to carry it over, so hand the
    noise that made the known frames to `start`. A smaller t_star pins harder.

    Replacing frames is not enough for a smooth seam: free frames follow the guess, and the guess
    for the known frames is never quite right. `dancediff.extensions.constraint` mends that.

    With ``hold_last`` the result ends in exactly the known frames ("init": never). The released
    code pins every step but the last.

    Shapes: known (b, n, k, d), abar (T,).
    Raises: ValueError for an unknown mode, or a t_star outside 0 ... T - 1.

    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> pin = Pinning(torch.ones(1, 1, 2, 1), cosine_abar())
    >>> x_T = pin.start(torch.randn(1, 1, 4, 1))
    >>> pin(torch.zeros(1, 1, 4, 1), t_next=-1).flatten().tolist()
    [1.0, 1.0, 0.0, 0.0]
    """

    known: Tensor
    abar: Tensor
    mode: str = "same_noise"
    t_star: int | None = None
    hold_last: bool = True
    generator: torch.Generator | None = None
    noise: Tensor | None = field(default=None, init=False)  # of the known frames, set by `start`

    def __post_init__(self):
        if self.mode not in MODES:
            raise ValueError(f"mode={self.mode!r} is not one of {', '.join(map(repr, MODES))}")
        last = len(self.abar) - 1
        if self.t_star is None:
            self.t_star = last
        if not 0 <= self.t_star <= last:
            raise ValueError(f"t_star={self.t_star} is outside 0 ... {last}, the schedule's steps")

    def start(self, x_T: Tensor) -> Tensor:
        """Put the known frames under the noise that x_T (b, n, f, d) already has there."""
        t = self.t_star if self.mode == "init" else len(self.abar) - 1
        self.noise = x_T[:, :, : self.known.shape[2]]
        return self._replace(x_T, q_sample(self.known, t, self.abar, self.noise))

    def __call__(self, x_next: Tensor, t_next: int) -> Tensor:
        """Pin x_next (b, n, f, d), which the sampler has just brought to step t_next."""
        if self.mode == "init" or (t_next == -1 and not self.hold_last):
            return x_next
        if self.mode == "clean" or t_next == -1:
            return self._replace(x_next, self.known)
        if self.mode == "same_noise":
            if self.noise is None:
                raise ValueError("mode='same_noise' needs the noise of the first input: call start")
            eps = self.noise
        else:
            eps = gaussian(
                self.known.shape, generator=self.generator, device=x_next.device, dtype=x_next.dtype
            )
        return self._replace(x_next, q_sample(self.known, t_next, self.abar, eps))

    def _replace(self, x: Tensor, start: Tensor) -> Tensor:
        b, n, k, d = start.shape
        if x.shape[:2] != (b, n) or x.shape[3] != d or x.shape[2] < k:
            raise ValueError(
                f"known {tuple(start.shape)} does not fit at the start of x {tuple(x.shape)}; "
                "both are (b, n, f, d) and x must be at least as long"
            )
        return torch.cat([start.to(x), x[:, :, k:]], dim=2)
