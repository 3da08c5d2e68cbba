r"""The transformer that chooses the next units of both halves from music and the units before.

Read first: Siyao et al. 2022 (Bailando), cross-conditional motion GPT.

Symbols (axes: b batch · u units · m music features of a unit's eight frames · k codes · d channels)
    codes    units of the upper and the lower half, times 0 .. u-1   (b, 2, u)
    M        music of times 1 .. u: that of the unit to be chosen    (b, u, m)
    logits   of the units of times 1 .. u                            (b, 2, u, k)
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.encoder_layer import EncoderLayer, causal_mask

STREAMS = 3  # music, upper half, lower half


class CrossConditionalGPT(nn.Module):
    r"""A causal transformer over three sequences that see each other.

    Tokens are [music; upper; lower]. The token of time i of any of them sees those of times 0 to i
    of all three: the mask is a lower triangle, repeated 3 x 3.

    Source: Bailando, cross-conditional motion GPT; layers of the released code.

    Shapes: see the module's symbols.
    Raises: ValueError when there are more units than positions.

    >>> sizes = {"num_heads": 2, "ff_dim": 32, "num_layers": 1, "head_layers": 1}
    >>> gpt = CrossConditionalGPT(16, num_codes=8, length=6, music_dim=280, **sizes)
    >>> gpt(torch.zeros(2, 2, 5, dtype=torch.long), torch.randn(2, 5, 280)).shape
    torch.Size([2, 2, 5, 8])
    """

    mask: Tensor

    def __init__(
        self,
        d_model: int,
        *,
        num_codes: int,
        length: int,
        music_dim: int,
        num_layers: int,
        head_layers: int,
        **layer,
    ):
        """``layer``: see `dancediff.nn.encoder_layer.EncoderLayer`."""
        super().__init__()
        self.length = length
        self.music = nn.Linear(music_dim, d_model)
        self.embed = nn.ModuleList(nn.Embedding(num_codes, d_model) for _ in range(STREAMS - 1))
        self.positions = nn.Parameter(0.02 * torch.randn(STREAMS, length, d_model))
        self.shared = nn.ModuleList(EncoderLayer(d_model, **layer) for _ in range(num_layers))
        self.head = nn.ModuleList(EncoderLayer(d_model, **layer) for _ in range(head_layers))
        self.norm = nn.LayerNorm(d_model)
        self.out = nn.ModuleList(
            nn.Linear(d_model, num_codes, bias=False) for _ in range(STREAMS - 1)
        )
        self.register_buffer("mask", causal_mask(length), persistent=False)

    def forward(self, codes: Tensor, M: Tensor) -> Tensor:
        """Logits of the units that come next."""
        return self.choose(self.features(codes, M))

    def features(self, codes: Tensor, M: Tensor) -> Tensor:
        """What the shared layers make of music and units, (b, 3 u, d)."""
        u = codes.shape[-1]
        if u > self.length or M.shape[1] != u:
            raise ValueError(
                f"codes have {u} times and the music {M.shape[1]}; expected the same, at most "
                f"{self.length}"
            )
        halves = [embed(codes[:, k]) for k, embed in enumerate(self.embed)]
        tokens = torch.stack([self.music(M), *halves], dim=1) + self.positions[:, :u]
        return self.through(self.shared, rearrange(tokens, "b s u d -> b (s u) d"))

    def choose(self, h: Tensor) -> Tensor:
        """Logits from the shared features."""
        h = self.norm(self.through(self.head, h))
        halves = rearrange(h, "b (s u) d -> s b u d", s=STREAMS)[1:]
        logits = [out(half) for out, half in zip(self.out, halves, strict=True)]
        return torch.stack(logits, dim=1).float()

    def through(self, layers: nn.ModuleList, h: Tensor) -> Tensor:
        """Causal layers over all three sequences."""
        u = h.shape[1] // STREAMS
        mask = self.mask[:u, :u].repeat(STREAMS, STREAMS)
        for layer in layers:
            h = layer(h, mask)
        return h
