r"""Trajectory-Specialist Diffusion (TSD): bodies for paths that are given.

Read first: Dai et al. 2025 (TCDiff) section 3.3 · `dancediff.nn.decoder`.

Symbols (axes: b batch · n dancers · f frames · d motion features · c channels)
    x_t      noisy motion whose root stands on the path, without noise     (b, n, f, d)
    path     places on the floor, normalised x and z                       (b, n, f, 2)
    h        tokens                                                        (b, n, f, c)
    v        displacement on the path since the frame before               (b, n, f, 2)
"""

from typing import Any

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.conditioning import ConcatSquashLinear, MusicConditioning
from dancediff.nn.decoder import (
    DecoderLayer,
    FusionProjection,
    frames_of_memory,
    read_out,
    token_frames,
)

SQUASH, EMBEDDED = 128, 64  # hidden widths of the adaptor and of the displacement's embedding


class LayerFootwork(nn.Module):
    r"""Footwork Adaptor inside a layer: tokens that know the path under their feet.

    $$h \leftarrow h + W\,\text{CSL}_3(\phi(\text{CSL}_2(\phi(\text{CSL}_1(h, e)), e)), e)$$

    Source: TCDiff section 3.3.  Differs: in the released code what it computes is dropped, and its
    last map has no residual around it.

    Shapes: h (b, n, f, c), context e (b, n, f, c) -> (b, n, f, c).

    >>> LayerFootwork(16)(torch.randn(2, 3, 5, 16), torch.randn(2, 3, 5, 16)).shape
    torch.Size([2, 3, 5, 16])
    """

    def __init__(self, d_model: int):
        """Three gated layers and a map."""
        super().__init__()
        self.first = ConcatSquashLinear(d_model, SQUASH, d_model)
        self.second = ConcatSquashLinear(SQUASH, SQUASH, d_model)
        self.third = ConcatSquashLinear(SQUASH, d_model, d_model)
        self.out = nn.Linear(d_model, d_model)

    def forward(self, h: Tensor, context: Tensor) -> Tensor:
        """See the equation."""
        x = F.leaky_relu(self.first(h, context))
        x = F.leaky_relu(self.second(x, context))
        return h + self.out(self.third(x, context))


class TrajectoryLayer(DecoderLayer):
    """Self-attention over all frames of all dancers, music, feed-forward, footwork.

    Source: TCDiff section 3.3.  Differs: dancers of a frame share its position, which in the
    released code counts dancers as frames.

    Shapes: h (b, n, f, c), memory (b, k, c), cond (b, c), context (b, n, f, c) -> like h.
    """

    def __init__(self, d_model: int, **sizes):
        """``sizes``: those of `DecoderLayer`."""
        super().__init__(d_model, **sizes)
        self.footwork = LayerFootwork(d_model)

    def forward(  # type: ignore[override] # a group's tokens tell their frames
        self, h: Tensor, memory: Tensor, cond: Tensor, context: Tensor, memory_frames: Tensor
    ) -> Tensor:
        """All blocks in turn."""
        tokens = rearrange(h, "b n f c -> b (f n) c")
        tokens = super().forward(tokens, memory, cond, token_frames(h), memory_frames)
        h = rearrange(tokens, "b (f n) c -> b n f c", n=h.shape[1])
        return self.footwork(h, context)


class TrajectoryDiffusion(MusicConditioning):
    r"""The denoiser: $\hat x = \text{decoder}(\text{FP}(W x_t),\; t, M, v)$.

    Source: TCDiff section 3.3.

    Shapes: x_t (b, n, f, d), t (b,), path (b, n, f, 2), conditions with music -> (b, n, f, d).
    """

    def __init__(self, config: Any):
        """``config``: a `TCDiffConfig`."""
        c, d = config, config.d_model
        blocks: dict[str, Any] = {"num_heads": c.num_heads, "ff_dim": c.ff_dim}
        blocks["dropout"] = c.dropout
        super().__init__(d, music_dim=c.music_dim, music_frames=c.num_frames, **blocks)
        self.embed = nn.Linear(c.motion_dim, d)
        self.fusion_projection = FusionProjection(c.max_dancers, d, c.fusion_hidden)
        self.displacement = nn.Sequential(
            nn.Linear(2, EMBEDDED), nn.LeakyReLU(), nn.Linear(EMBEDDED, d)
        )
        self.norm_memory = nn.LayerNorm(d)
        self.layers = nn.ModuleList(TrajectoryLayer(d, **blocks) for _ in range(c.num_layers))
        self.out = nn.Linear(d, c.motion_dim)

    def forward(self, x_t: Tensor, t: Tensor, path: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean motion of everybody at once."""
        music, steps, cond = self.condition(t, conditions)
        h = self.decode(self.place(self.embed(x_t)), [music, steps], cond, self.context(t, path))
        return self.read(h)

    def place(self, h: Tensor) -> Tensor:
        """Mix the dancers (FP)."""
        return self.fusion_projection(h).float()

    def context(self, t: Tensor, path: Tensor) -> Tensor:
        """What the footwork is conditioned on: the step and the displacement, (b, n, f, c)."""
        step, _ = self.timestep(t)
        return (self.displacement(displacement(path)) + step[:, None, None]).float()

    def decode(self, h: Tensor, memory: list[Tensor], cond: Tensor, context: Tensor) -> Tensor:
        """All layers, (b, n, f, c) -> the same; ``memory``: music tokens, then others."""
        tokens = self.norm_memory(torch.cat(memory, dim=1))
        of_music = torch.arange(memory[0].shape[1], device=h.device)
        frames = frames_of_memory(tokens.shape[1], of_music)
        for layer in self.layers:
            h = layer(h, tokens, cond, context, frames)
        return h

    def read(self, h: Tensor) -> Tensor:
        """From tokens (b, n, f, c) to motion (b, n, f, d)."""
        return read_out(self.out, h)


def displacement(path: Tensor) -> Tensor:
    """How far each dancer went since the frame before; 0 in the first.

    Source: TCDiff section 3.3.  Differs: the released code takes it from one dancer to the next.

    Shapes: (b, n, f, 2) -> (b, n, f, 2).

    >>> displacement(torch.tensor([[[[0.0, 0.0], [0.1, 0.0]]]])).tolist()
    [[[[0.0, 0.0], [0.10000000149011612, 0.0]]]]
    """
    return F.pad(path.diff(dim=2), (0, 0, 1, 0))


def on_path(x: Tensor, path: Tensor) -> Tensor:
    """Motion whose root stands on the path; heights stay as they are.

    Shapes: x (b, n, f, d), path (b, n, f, 2) -> like x.

    >>> on_path(torch.zeros(1, 1, 2, 151), torch.ones(1, 1, 2, 2)).sum().item()
    4.0
    """
    x = x.clone()
    x[..., TCDIFFPP.floor] = path.to(x)
    return x
