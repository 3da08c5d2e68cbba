r"""FACT: a transformer that sees 2 s of dance and 4 s of music, and guesses what comes next.

Read first: Li et al. 2021 (AI Choreographer).

Symbols (axes: b batch · s frames of motion that it sees · w frames of music · k frames that it
         guesses · d motion, m music features)
    history   motion, normalised                                            (b, s, d)
    M         music from the first frame of the history on, standardised    (b, w, m)
    guess     motion after the history                                      (b, k, d)
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor, nn

from dancediff.autoregression.network import (
    AutoregressiveNetwork,
    check_seen,
    check_targets,
    moved_to_origin,
)
from dancediff.autoregression.roll_out import roll_out
from dancediff.data.windows import Batch
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.encoder_layer import EncoderLayer
from dancediff.nn.losses import mean


@dataclass(frozen=True)
class FACTConfig:
    """Sizes; plain values, so that it can be stored as JSON. The defaults are for a laptop.

    >>> FACTConfig.paper().d_model, FACTConfig().num_frames
    (800, 120)
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    motion_layers: int = 1  # that see motion alone
    music_layers: int = 1  # that see music alone
    num_layers: int = 4  # that see both
    ff_dim: int = 512  # width inside a feed-forward block
    seed_frames: int = 60  # 2 seconds of motion that it sees
    music_frames: int = 120  # 4 seconds
    targets: int = 10  # frames that it guesses, a third of a second
    max_dancers: int = 10  # who find a place on the stage; the network knows one
    motion_dim: int = 151  # features of a dancer's frame
    music_dim: int = 35  # features of a frame of music

    @classmethod
    def paper(cls, **changes) -> "FACTConfig":
        """Sizes of the released FACT; times are the published ones, at 30 frames a second."""
        sizes = {"d_model": 800, "num_heads": 10, "motion_layers": 2, "music_layers": 2}
        sizes |= {"num_layers": 12, "ff_dim": 3072}
        return cls(**sizes | changes)

    @property
    def num_frames(self) -> int:
        """Length of a window to learn from."""
        return max(self.music_frames, self.seed_frames + self.targets)


class Encoder(nn.Module):
    """Features of a sequence to tokens, with a learned vector for each position, and layers.

    >>> Encoder(35, 16, frames=9, num_layers=1, num_heads=2, ff_dim=32)(torch.zeros(2, 9, 35)).shape
    torch.Size([2, 9, 16])
    """

    def __init__(self, features: int, d_model: int, *, frames: int, num_layers: int, **layer):
        """``layer``: see `dancediff.nn.encoder_layer.EncoderLayer`."""
        super().__init__()
        self.embed = nn.Linear(features, d_model)
        self.positions = nn.Parameter(0.02 * torch.randn(frames, d_model))
        self.layers = nn.Sequential(
            *(EncoderLayer(d_model, qkv_bias=False, **layer) for _ in range(num_layers))
        )

    def forward(self, x: Tensor) -> Tensor:
        """(b, f, features) -> (b, f, d_model)."""
        return self.layers(self.embed(x) + self.positions)


class FACT(AutoregressiveNetwork):
    r"""The full-attention cross-modal transformer.

    $$\hat x_{s+1} \dots \hat x_{s+k} = \text{cross-modal}(\text{motion}(x_1 \dots x_s),\
      \text{music}(M_1 \dots M_w))_{1 \dots k}$$

    All tokens see all others. The guess of frame s + i is read off the i-th motion token.

    Source: AI Choreographer, the FACT model; sizes of the released code.  Differs: 30
    frames a second instead of 60; the 151-d vector, whose rotations are 6-D and whose contacts are
    guessed like the rest, instead of 219-d; places are seen from the last frame of the history, so
    that a dance is the same anywhere on the stage; attention is scaled by the width of a head,
    where the code takes that of all heads.

    Shapes: history (b, s, d), M (b, w, m) -> (b, k, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> model = FACT(FACTConfig(d_model=16, num_heads=2, num_layers=1, ff_dim=32))
    >>> model(torch.randn(2, 60, 151), torch.randn(2, 120, 35)).shape
    torch.Size([2, 10, 151])
    """

    stages = ("train",)
    config: FACTConfig

    def __init__(self, config: FACTConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or FACTConfig()
        check_targets(c)
        super().__init__(c.motion_dim, c.music_dim)
        self.config = c
        layer: dict[str, Any] = {"num_heads": c.num_heads, "ff_dim": c.ff_dim}
        self.motion = Encoder(
            c.motion_dim, c.d_model, frames=c.seed_frames, num_layers=c.motion_layers, **layer
        )
        self.music = Encoder(
            c.music_dim, c.d_model, frames=c.music_frames, num_layers=c.music_layers, **layer
        )
        self.cross_modal = nn.Sequential(
            *(EncoderLayer(c.d_model, qkv_bias=False, **layer) for _ in range(c.num_layers))
        )
        self.out = nn.Linear(c.d_model, c.motion_dim)

    def forward(self, history: Tensor, M: Tensor) -> Tensor:
        """See the equation."""
        check_seen(history, M, self.config)
        here = history[:, -1:, TCDIFFPP.floor]
        tokens = [self.motion(moved_to_origin(history, at=-1)), self.music(M)]
        h = self.cross_modal(torch.cat(tokens, dim=1))[:, : self.config.targets]
        guess = self.out(h).float()
        guess[..., TCDIFFPP.floor] += here
        return guess

    def losses(self, batch: Batch, stage: str, generator: torch.Generator) -> dict[str, Tensor]:
        """`future_loss` of windows whose first frames are the history."""
        c, x = self.config, batch.x.flatten(0, 1)
        seen, later = x[:, : c.seed_frames], x[:, c.seed_frames :][:, : c.targets]
        M = batch.M.repeat_interleave(batch.x.shape[1], 0)[:, : c.music_frames]
        loss = future_loss(self(seen, M), later)
        return {"future": loss, "total": loss}

    @property
    def history_frames(self) -> int:
        """Two seconds."""
        return self.config.seed_frames

    def dance(
        self, history: Tensor, M: Tensor, request: Any, generators: Sequence[torch.Generator]
    ) -> Iterator[Tensor]:
        """Roll out: ``request.keep`` frames of each guess; nothing is drawn.

        Source: AI Choreographer, where one frame is kept.
        """
        how = {"frames": request.frames, "keep": request.keep, "window": self.config.music_frames}
        return roll_out(self, history, M, **how)


def future_loss(guess: Tensor, truth: Tensor) -> Tensor:
    r"""The frames after the history, all alike: $\lVert x_{s+i} - \hat x_{s+i} \rVert^2$.

    Source: AI Choreographer, future-N supervision: k frames are supervised, though one is kept.
    Shapes: (b, k, d) normalised -> scalar.

    >>> future_loss(torch.ones(1, 2, 3), torch.zeros(1, 2, 3)).item()
    1.0
    """
    return mean((guess - truth).square())
