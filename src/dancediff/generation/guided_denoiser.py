r"""A network with guidance, as a function of noisy motion and step for each set of conditions.

Read first: `dancediff.diffusion.guidance` · `dancediff.extensions.autoguidance`.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided, off_at_the_end
from dancediff.extensions.autoguidance import (
    LASTING_SHARE,
    ROOT_SHARE,
    autoguided,
    last_pushed,
    linear_guess_of,
)
from dancediff.extensions.genre_guidance import genre_guided

Denoise = Callable[[Tensor, int], Tensor]


@dataclass(frozen=True)
class GuidedDenoiser:
    """A network whose guesses are pushed by guidance.

    - ``guidance``: a weight or a function of t, see `dancediff.diffusion.guidance.guided`.
    - ``autoguidance``: see `dancediff.extensions.autoguidance.autoguided`; ``autoguidance_end``:
      see `dancediff.extensions.autoguidance.last_pushed`.
    - ``genre_guidance``: see `dancediff.extensions.genre_guidance.genre_guided`.
    """

    model: Any  # a network with `denoise` and `linear_guess`
    guidance: float | Callable[[int], float]
    autoguidance: float
    autoguidance_end: float
    genre_guidance: float | None = None  # of networks that know genres
    dtype: torch.dtype | None = None  # bfloat16: the network computes with fewer digits

    @classmethod
    def of(cls, model, request, dtype: torch.dtype | None = None) -> "GuidedDenoiser":
        """With the weights of a resolved request."""
        guidance = request.guidance
        if request.sampler == "ddpm":
            guidance = off_at_the_end(guidance, model.config.num_steps)
        of_genre = getattr(request, "genre_guidance", None)  # only TCDiff++ has it
        end = request.autoguidance_end
        return cls(model, guidance, request.autoguidance, end, of_genre, dtype)

    def bind(self, conditions: Conditions) -> Denoise:
        """The guesses for these conditions, a function of x_t and t."""
        denoise = self.with_music(conditions)
        if self.genre_guidance not in (None, 1):  # 1 is as learned: one guess does
            denoise = genre_guided(self.with_music, conditions, self.genre_guidance)
        if self.autoguidance == 1:
            return denoise
        return autoguided(
            denoise,
            linear_guess_of(self.model, conditions),
            self.autoguidance,
            root_share=ROOT_SHARE,
            lasting_share=LASTING_SHARE,
            last=last_pushed(self.model.abar, self.autoguidance_end),
        )

    def with_music(self, conditions: Conditions) -> Denoise:
        """As `bind`, with guidance by music alone."""
        return guided(self.denoise, conditions, self.guidance)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What the network guesses, without any guidance."""
        few_digits = self.dtype == torch.bfloat16
        with torch.autocast(self.model.abar.device.type, torch.bfloat16, enabled=few_digits):
            return self.model.denoise(x_t, t, conditions)
