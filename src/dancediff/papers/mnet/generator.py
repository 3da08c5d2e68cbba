r"""MNET's generator: motion so far, music and a style token to the frames that come next.

Read first: Kim et al. 2022 (A Brand New Dance Partner).

Symbols (axes: b batch · s frames of motion · w frames of music · l = s + w tokens · d channels)
    history   motion, normalised and seen from its last frame   (b, s, motion)
    M         music, standardised                               (b, w, music)
    style     the style token                                   (b, d)
"""

from typing import Any

import torch
from torch import Tensor, nn

from dancediff.nn.attention import FeedForward
from dancediff.nn.encoder_layer import SelfAttention


class StyledLayer(nn.Module):
    r"""Self-attention with a learned bias for every pair of tokens, the style, and feed-forward.

    $$h \leftarrow h + \text{attention}(\text{LN}(h), B), \quad
      h \leftarrow h + W_2 W_1\, style, \quad h \leftarrow h + \text{feed-forward}(\text{LN}(h))$$

    Source: MNET's code; the heads share the bias, which stands for positions.  Differs: the code
    lets tokens attend to the style token. The softmax over one token is 1, whatever queries and
    keys are, so that only the maps of values are left: they stand here, and do the same.

    Shapes: h (b, l, d), style (b, d) -> (b, l, d).

    >>> layer = StyledLayer(16, tokens=9, num_heads=2, ff_dim=32)
    >>> layer(torch.randn(2, 9, 16), torch.randn(2, 16)).shape
    torch.Size([2, 9, 16])
    """

    def __init__(self, d_model: int, *, tokens: int, num_heads: int, ff_dim: int):
        super().__init__()
        self.attention = SelfAttention(d_model, num_heads, qkv_bias=False)
        self.bias = nn.Parameter(0.02 * torch.randn(tokens, tokens))
        self.style = nn.Sequential(
            nn.Linear(d_model, d_model, bias=False), nn.Linear(d_model, d_model)
        )
        self.feed_forward = FeedForward(d_model, ff_dim)
        self.norms = nn.ModuleList(nn.LayerNorm(d_model) for _ in range(2))

    def forward(self, h: Tensor, style: Tensor) -> Tensor:
        """See the equations."""
        h = h + self.attention(self.norms[0](h), self.bias)
        h = h + self.style(style)[:, None]
        return h + self.feed_forward(self.norms[1](h))


class Generator(nn.Module):
    """The frames after a history, read off the first tokens.

    Source: MNET's code.

    Shapes: see the module's symbols; returns (b, targets, motion).

    >>> sizes = {"seed_frames": 6, "music_frames": 9, "targets": 3, "num_layers": 1}
    >>> generator = Generator(16, motion_dim=151, music_dim=35, num_heads=2, ff_dim=32, **sizes)
    >>> generator(torch.randn(2, 6, 151), torch.randn(2, 9, 35), torch.randn(2, 16)).shape
    torch.Size([2, 3, 151])
    """

    def __init__(
        self,
        d_model: int,
        *,
        motion_dim: int,
        music_dim: int,
        seed_frames: int,
        music_frames: int,
        targets: int,
        num_layers: int,
        **layer: Any,
    ):
        """``layer``: the heads and the width of `StyledLayer`."""
        super().__init__()
        self.targets = targets
        self.motion = nn.Linear(motion_dim, d_model)
        self.music = nn.Linear(music_dim, d_model)
        tokens = seed_frames + music_frames
        self.layers = nn.ModuleList(
            StyledLayer(d_model, tokens=tokens, **layer) for _ in range(num_layers)
        )
        self.out = nn.Linear(d_model, motion_dim)

    def forward(self, history: Tensor, M: Tensor, style: Tensor) -> Tensor:
        """Tokens are [history; music]."""
        h = torch.cat([self.motion(history), self.music(M)], dim=1)
        for layer in self.layers:
            h = layer(h, style)
        return self.out(h[:, : self.targets]).float()
