r"""MNET's critic: does this look like a dance of that genre to that music?

Read first: Kim et al. 2022 (A Brand New Dance Partner) · notebook 12.

Symbols (axes: b batch · f frames of motion · w frames of music · d channels · g genres)
    x        motion with its history, normalised   (b, f, motion)
    M        music, standardised                   (b, w, music)
    genre    number of the genre                   (b,)
    scores   above 0: true                         (b,)
"""

from typing import Any

import torch
from torch import Tensor, nn

from dancediff.nn.encoder_layer import EncoderLayer
from dancediff.nn.losses import mean
from dancediff.nn.mapping_network import MappingNetwork


class GenreCritic(nn.Module):
    """One score for each genre, of which that of the genre asked for is taken.

    Source: MNET's code.  Differs: ``hidden`` is 1 there, so that one number carries all verdicts;
    the critic sees the history, too, so that a jump behind it costs something.

    Shapes: x (b, f, motion), M (b, w, music), genre (b,) -> (b,).

    >>> sizes = {"num_layers": 1, "num_heads": 2, "ff_dim": 32, "hidden": 8, "genres": 3}
    >>> critic = GenreCritic(16, motion_dim=151, music_dim=35, tokens=15, **sizes)
    >>> critic(torch.randn(2, 6, 151), torch.randn(2, 9, 35), torch.tensor([0, 2])).shape
    torch.Size([2])
    """

    def __init__(
        self,
        d_model: int,
        *,
        motion_dim: int,
        music_dim: int,
        tokens: int,
        num_layers: int,
        hidden: int,
        genres: int,
        **layer: Any,
    ):
        """``layer``: the heads and the width of `dancediff.nn.encoder_layer.EncoderLayer`."""
        super().__init__()
        self.motion = nn.Linear(motion_dim, d_model)
        self.music = nn.Linear(music_dim, d_model)
        self.layers = nn.ModuleList(
            EncoderLayer(d_model, qkv_bias=False, **layer) for _ in range(num_layers)
        )
        self.biases = nn.Parameter(0.02 * torch.randn(num_layers, tokens, tokens))
        self.scores = MappingNetwork(d_model, 1, genres, hidden=hidden)

    def forward(self, x: Tensor, M: Tensor, genre: Tensor) -> Tensor:
        """The mean over all tokens goes through the head of the genre."""
        h = torch.cat([self.motion(x), self.music(M)], dim=1)
        for layer, bias in zip(self.layers, self.biases, strict=True):
            h = layer(h, bias)
        return self.scores.of_genre(h.mean(1), genre)[:, 0].float()


def hinge(real: Tensor, fake: Tensor) -> Tensor:
    r"""What the critic minimises: $\max(0, 1 - real) + \max(0, 1 + fake)$.

    Source: MNET's code.  Shapes: (b,), (b,) -> scalar.

    >>> hinge(torch.tensor([2.0, 0.0]), torch.tensor([-2.0, -2.0])).item()
    0.5
    """
    return mean((1 - real).relu()) + mean((1 + fake).relu())


def style_consistency(asked: Tensor, other: Tensor) -> Tensor:
    r"""A dance for one genre should score well as that, and badly as another: $-D_a + D_b$.

    Source: MNET.  Differs: in the released code both terms have a minus, so that scoring well as
    the other genre is rewarded, too.

    >>> style_consistency(torch.tensor([1.0]), torch.tensor([3.0])).item()
    2.0
    """
    return mean(other - asked)


def diversity(z_1: Tensor, z_2: Tensor, x_1: Tensor, x_2: Tensor) -> Tensor:
    r"""Other noise should be another dance: $\lVert z_1 - z_2 \rVert_1 / (\lVert x_1 - x_2
    \rVert_1 + 0.1)$.

    Source: MNET.  Differs: the released code compares style tokens, which may simply grow; here
    dances are compared, and 0.1 bounds the ratio. Norms are means.

    Shapes: z (b, z), x (b, k, d) -> scalar.

    >>> diversity(torch.ones(1, 2), torch.zeros(1, 2), torch.ones(1, 3, 2), torch.zeros(1, 3, 2))
    tensor(0.9091)
    """
    moved = (x_1 - x_2).abs().flatten(1).mean(1)
    return mean((z_1 - z_2).abs().mean(1) / (moved + 0.1))
