"""What all networks that make dances have besides their layers."""

from typing import Any

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import Generators, cosine_abar
from dancediff.motion.representation import Normalizer
from dancediff.music.features import MusicNormalizer


class NormalizedNetwork(nn.Module):
    """Normalisers that change nothing until training fits them.

    >>> network = NormalizedNetwork(motion_dim=151, music_dim=35)
    >>> network.normalizer.normalize(torch.ones(151)).unique().tolist(), network.device
    ([1.0], device(type='cpu'))
    """

    config: Any  # its sizes, of a class of its own

    def __init__(self, motion_dim: int, music_dim: int):
        super().__init__()
        one = torch.ones(motion_dim)
        self.normalizer = Normalizer(-one, one)
        self.music_normalizer = MusicNormalizer(torch.zeros(music_dim), torch.ones(music_dim))

    @property
    def device(self) -> torch.device:
        """Where it computes."""
        return self.normalizer.low.device


class DanceNetwork(NormalizedNetwork):
    """A network that denoises dances: it has the noise schedule, too.

    >>> network = DanceNetwork(motion_dim=151, music_dim=35, num_steps=1000)
    >>> network.abar.shape
    torch.Size([1000])
    """

    abar: Tensor

    def __init__(self, motion_dim: int, music_dim: int, num_steps: int):
        super().__init__(motion_dim, music_dim)
        self.register_buffer("abar", cosine_abar(num_steps), persistent=False)

    def with_draws(self, conditions: Conditions, generator: Generators = None) -> Conditions:
        """The conditions with what the network draws for each row besides noise; here nothing."""
        return conditions
