r"""Sequence Decoder (SD): M layers that see everybody, remember, and listen.

Read first: notebook 08 · TCDiff++ section 4.2.

Symbols (axes: b batch · n dancers · f frames · k memory tokens · d channels)
    h        tokens                                              (b, n, f, d)
    memory   [swap mode 1, music f, step 2] after a LayerNorm    (b, k, d)
    cond     what FiLM listens to                                (b, d)
"""

import torch
from torch import Tensor, nn

from dancediff.nn.decoder import DecoderLayer
from dancediff.nn.ssm import MambaBlock


class SequenceDecoder(nn.Module):
    r"""A stack of decoder layers: self-attention, Mamba, cross-attention, feed-forward, with FiLM.

    Self-attention spans all frames of all dancers; the state space model runs along each dancer's
    own time axis, so it costs the same per dancer however many there are.

    Source: TCDiff++ section 4.2.  Differs: see `dancediff.nn.decoder.DecoderLayer`.

    Shapes: h (b, n, f, d), memory (b, k, d), cond (b, d) -> (b, n, f, d).

    >>> decoder = SequenceDecoder(16, num_layers=1, num_heads=2, ff_dim=32)
    >>> h, memory, cond = torch.randn(1, 2, 6, 16), torch.randn(1, 9, 16), torch.randn(1, 16)
    >>> decoder(h, memory, cond, music_start=1).shape
    torch.Size([1, 2, 6, 16])
    """

    def __init__(
        self,
        d_model: int,
        *,
        num_layers: int,
        num_heads: int,
        ff_dim: int,
        ssm: str = "ssd",
        layer: str = "paper",
        dropout: float = 0.0,
        **ssm_options,
    ):
        """``ssm``: "ssd", "mamba" or "none"; ``layer``: see `DecoderLayer`; rest: `MambaBlock`."""
        super().__init__()
        self.norm_memory = nn.LayerNorm(d_model)
        self.layers = nn.ModuleList(
            DecoderLayer(
                d_model,
                num_heads=num_heads,
                ff_dim=ff_dim,
                ssm=None if ssm == "none" else MambaBlock(d_model, ssm=ssm, **ssm_options),
                layer=layer,
                dropout=dropout,
            )
            for _ in range(num_layers)
        )

    def forward(self, h: Tensor, memory: Tensor, cond: Tensor, *, music_start: int) -> Tensor:
        """``music_start``: index of the memory token that belongs to frame 0."""
        f = h.shape[2]
        # Only music belongs to a frame. Frame 0 means "not turned" to the other tokens.
        frames = torch.zeros(memory.shape[1], dtype=torch.long, device=h.device)
        frames[music_start : music_start + f] = torch.arange(f, device=h.device)
        memory = self.norm_memory(memory)
        for layer in self.layers:
            h = layer(h, memory, cond, frames)
        return h
