r"""GCD: Group Contrastive Diffusion; a song and a latent in, a group dance out.

Read first: Le et al. 2023 (GCD) section 3 · `dancediff.papers.gcd.group_modulation`.

Symbols (axes: b batch · n dancers · f frames · d motion features · k tokens · c channels)
    x_t     noisy motion, normalised                       (b, n, f, d)
    x_hat   the guess                                      (b, n, f, d)
    z       latent of the group, drawn once for a dance    (b, d_model)
    w       group embedding                                (b, d_model)
    h       tokens                                         (b, n, f, d_model)
"""

from dataclasses import dataclass, replace
from typing import Any

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import Generators, gaussian
from dancediff.nn.conditioning import MusicConditioning
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.decoder import DecoderLayer, check_group, check_shapes, frames_of_memory, read_out
from dancediff.papers.gcd.consistency_critic import ConsistencyCritic
from dancediff.papers.gcd.group_attention import GroupGlobalAttention
from dancediff.papers.gcd.group_modulation import GroupEmbedding, GroupModulation


@dataclass(frozen=True)
class GCDConfig:
    """Sizes; plain values, so that it can be stored as JSON.

    The defaults are a small model which two CPU cores can train; `paper` has the published sizes.

    >>> GCDConfig.paper().num_layers
    5
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    num_layers: int = 3  # blocks of the decoder
    ff_dim: int = 256  # width inside a feed-forward block
    critic_layers: int = 1  # blocks of the critic
    negatives: int = 2  # of each group, for the contrast
    max_dancers: int = 5  # of a group
    num_frames: int = 150  # of one segment: 5 seconds
    motion_dim: int = 151  # features of a dancer's frame
    music_dim: int = 35  # features of a frame of music
    dropout: float = 0.0  # share of values that are set to zero in training
    cond_drop: float = 0.2  # share of windows in training whose music is masked
    num_steps: int = 1000  # noise levels

    @classmethod
    def paper(cls, **changes) -> "GCDConfig":
        """Sizes of GCD section 4.1: 5 blocks, 8 heads, width 512; a critic of 2 as in its code."""
        sizes = {"d_model": 512, "num_heads": 8, "num_layers": 5, "ff_dim": 1024}
        return cls(**sizes | {"critic_layers": 2, "negatives": 10, "dropout": 0.1} | changes)


class GCDBlock(nn.Module):
    """Each dancer with the music, then all dancers with each other, then what w tells them.

    Source: GCD section 3.3.

    Shapes: h (b, n, f, c), memory (b, k, c), cond, w (b, c) -> like h.
    """

    def __init__(self, d_model: int, max_dancers: int, **sizes):
        """``sizes``: those of `DecoderLayer`."""
        super().__init__()
        self.local = DecoderLayer(d_model, **sizes)
        self.group = GroupGlobalAttention(d_model, max_dancers, **sizes)
        self.modulation = GroupModulation(d_model)

    def forward(self, h: Tensor, memory: Tensor, cond: Tensor, w: Tensor, frames: Tensor) -> Tensor:
        """The three steps in turn; ``frames``: that of each memory token (k,)."""
        b, n, f, _ = h.shape
        alone = rearrange(h, "b n f c -> (b n) f c")
        memory, cond = (part.repeat_interleave(n, 0) for part in (memory, cond))
        alone = self.local(alone, memory, cond, torch.arange(f, device=h.device), frames)
        return self.modulation(self.group(rearrange(alone, "(b n) f c -> b n f c", b=b)), w)


class GCDDecoder(MusicConditioning):
    r"""The denoiser: $\hat x = \text{decoder}(x_t, t, M, w)$.

    Source: GCD section 3.3.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music and latent -> (b, n, f, d).
    """

    def __init__(self, config: GCDConfig):
        c, d = config, config.d_model
        blocks: dict[str, Any] = {
            "num_heads": c.num_heads,
            "ff_dim": c.ff_dim,
            "dropout": c.dropout,
        }
        super().__init__(d, music_dim=c.music_dim, music_frames=c.num_frames, **blocks)
        self.embed = nn.Linear(c.motion_dim, d)
        self.group_embedding = GroupEmbedding(d, c.max_dancers)
        self.norm_memory = nn.LayerNorm(d)
        self.blocks = nn.ModuleList(
            GCDBlock(d, c.max_dancers, **blocks) for _ in range(c.num_layers)
        )
        self.out = nn.Linear(d, c.motion_dim)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean motion of everybody at once."""
        music, steps, cond = self.condition(t, conditions)
        w = self.group_embedding(conditions.latent, music, x_t.shape[1])
        return self.read(self.decode(self.embed(x_t), [music, steps], cond, w))

    def decode(self, h: Tensor, memory: list[Tensor], cond: Tensor, w: Tensor) -> Tensor:
        """All blocks, (b, n, f, d_model) -> the same; ``memory``: music tokens, then others."""
        h = h.float()  # the residual stream stays in float32 under autocast
        tokens = self.norm_memory(torch.cat(memory, dim=1))
        of_music = torch.arange(memory[0].shape[1], device=h.device)
        frames = frames_of_memory(tokens.shape[1], of_music)
        for block in self.blocks:
            h = block(h, tokens, cond, w, frames)
        return h

    def read(self, h: Tensor) -> Tensor:
        """From tokens (b, n, f, d_model) to motion (b, n, f, d)."""
        return read_out(self.out, h)


class GCD(DanceNetwork):
    r"""The whole model: decoder, critic, normalisers and noise schedule.

    Source: GCD section 3.  Differs: 35-d music features instead of Jukebox's 4800; the contrast
    trains on noisy groups, so that the critic's gradient needs no pass through the decoder, where
    the paper denoises its negatives first; a group of any size up to ``max_dancers`` needs no
    padding, since all groups of a batch have the same size.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music and latent -> x_hat (b, n, f, d).
    Without a latent z is 0.
    Raises: ValueError naming the argument whose shape does not fit.

    >>> model = GCD(GCDConfig(d_model=16, num_layers=1, ff_dim=32))
    >>> x_t, conditions = torch.randn(2, 3, 20, 151), Conditions(torch.randn(2, 20, 35))
    >>> model(x_t, torch.tensor([10, 900]), model.with_draws(conditions)).shape
    torch.Size([2, 3, 20, 151])
    """

    config: GCDConfig

    def __init__(self, config: GCDConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or GCDConfig()
        super().__init__(c.motion_dim, c.music_dim, c.num_steps)
        self.config = c
        self.decoder = GCDDecoder(c)
        self.critic = ConsistencyCritic(
            c.d_model,
            c.max_dancers,
            motion_dim=c.motion_dim,
            num_layers=c.critic_layers,
            num_heads=c.num_heads,
            ff_dim=c.ff_dim,
            dropout=c.dropout,
        )

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean dance."""
        self.check(x_t, t, conditions)
        return self.decoder(x_t, t, conditions)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess, (b, n, f, d)."""
        return self(x_t, t, conditions)

    def embedding(self, conditions: Conditions, n: int) -> Tensor:
        """Group embedding w of n dancers, (b, d_model); what the critic is asked with."""
        no_step = torch.zeros(len(conditions), dtype=torch.long, device=self.abar.device)
        music, _, _ = self.decoder.condition(no_step, conditions)
        return self.decoder.group_embedding(conditions.latent, music, n)

    def with_draws(self, conditions: Conditions, generator: Generators = None) -> Conditions:
        """The conditions with a latent for each row, unless they have one."""
        if conditions.latent is not None:
            return conditions
        M = conditions.music
        z = gaussian((len(M), self.config.d_model), generator=generator, device=M.device)
        return replace(conditions, latent=z)

    def check(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> None:
        """Refuse shapes that do not fit."""
        check_group(x_t, self.config)
        (b, _, f, _), c = x_t.shape, self.config
        check_shapes(t=(t, (b,)), music=(conditions.music, (b, f, c.music_dim)))
        if conditions.latent is not None:
            check_shapes(latent=(conditions.latent, (b, c.d_model)))
