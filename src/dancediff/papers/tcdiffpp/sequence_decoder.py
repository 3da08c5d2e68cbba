r"""Sequence Decoder (SD): layers that attend to everybody, remember, and attend to the conditions.

Read first: notebook 08 · TCDiff++ section 4.1.

Symbols (axes: b batch · n dancers · f frames · k memory tokens · d channels)
    h        tokens                                 (b, n, f, d)
    memory   [swap mode 1, music f, step 2]         (b, k, d)
    cond     step, music and swap mode for FiLM     (b, d)
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.decoder import DecoderLayer, frames_of_memory, token_frames
from dancediff.nn.ssm import MambaBlock


class GroupDanceLayer(DecoderLayer):
    r"""Self-attention, state space model, cross-attention, feed-forward (SA - SSM - CA - FF).

    $$h \leftarrow h + \text{FiLM}_i(\text{block}_i(\text{LN}_i(h)), c), \qquad i = 1 \dots 4$$

    Self-attention spans all frames of all dancers; the state space model runs along each dancer's
    own time axis, so it costs the same per dancer however many there are.

    Source: TCDiff++ section 4.1, pre-norm and FiLM on the branch as in EDGE.  Differs: the released
    code trains EDGE's layer, or puts the state space model in the place of cross-attention, where
    it scans the interleaved frames of all dancers as one long stream and no music comes in.

    Shapes: see the module's symbols; memory_frames (k,) the frame of each memory token.

    >>> layer = GroupDanceLayer(16, num_heads=2, ff_dim=32)
    >>> h, memory, cond = torch.randn(2, 3, 5, 16), torch.randn(2, 7, 16), torch.randn(2, 16)
    >>> layer(h, memory, cond, torch.arange(7)).shape
    torch.Size([2, 3, 5, 16])
    """

    num_blocks = 4

    def __init__(self, d_model: int, **sizes):
        """``sizes``: those of `DecoderLayer`."""
        super().__init__(d_model, **sizes)
        self.ssm = MambaBlock(d_model)

    def forward(  # type: ignore[override] # a group's tokens tell their frames
        self, h: Tensor, memory: Tensor, cond: Tensor, memory_frames: Tensor
    ) -> Tensor:
        """Run the four blocks in turn."""
        tokens, frames, n = rearrange(h, "b n f d -> b (f n) d"), token_frames(h), h.shape[1]
        attend, cross_attend, feed_forward = self.blocks(memory, frames, memory_frames)

        def along_time(x: Tensor) -> Tensor:
            streams = self.ssm(rearrange(x, "b (f n) d -> (b n) f d", n=n))
            return rearrange(streams, "(b n) f d -> b (f n) d", n=n)

        tokens = self.run(tokens, cond, [attend, along_time, cross_attend, feed_forward])
        return rearrange(tokens, "b (f n) d -> b n f d", n=n)


class GroupDanceLayerWithoutSSM(DecoderLayer):
    """`GroupDanceLayer` without the state space model: our reading of "w/o SD" in Table 4."""

    def forward(  # type: ignore[override] # a group's tokens tell their frames
        self, h: Tensor, memory: Tensor, cond: Tensor, memory_frames: Tensor
    ) -> Tensor:
        """Run the three blocks in turn."""
        tokens = rearrange(h, "b n f d -> b (f n) d")
        tokens = super().forward(tokens, memory, cond, token_frames(h), memory_frames)
        return rearrange(tokens, "b (f n) d -> b n f d", n=h.shape[1])


class SequenceDecoder(nn.Module):
    r"""A stack of decoder layers.

    Source: TCDiff++ section 4.1.

    Shapes: h (b, n, f, d), memory (b, k, d), cond (b, d) -> (b, n, f, d).

    >>> decoder = SequenceDecoder(16, num_layers=1, num_heads=2, ff_dim=32)
    >>> h, memory, cond = torch.randn(1, 2, 6, 16), torch.randn(1, 9, 16), torch.randn(1, 16)
    >>> decoder(h, memory, cond).shape
    torch.Size([1, 2, 6, 16])
    """

    def __init__(self, d_model: int, *, num_layers: int, with_ssm: bool = True, **sizes):
        """``sizes``: those of `DecoderLayer`."""
        super().__init__()
        layer = GroupDanceLayer if with_ssm else GroupDanceLayerWithoutSSM
        self.norm_memory = nn.LayerNorm(d_model)
        self.layers = nn.ModuleList(layer(d_model, **sizes) for _ in range(num_layers))

    def forward(self, h: Tensor, memory: Tensor, cond: Tensor) -> Tensor:
        """Run the layers."""
        of_music = torch.arange(h.shape[2], device=h.device)
        frames = frames_of_memory(memory.shape[1], of_music, first=1)  # the swap token comes first
        memory = self.norm_memory(memory)
        for layer in self.layers:
            h = layer(h, memory, cond, frames)
        return h
