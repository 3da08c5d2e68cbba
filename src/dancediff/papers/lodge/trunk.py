r"""The transformer that both stages of Lodge share: EDGE's, for tokens that sit anywhere in a song.

Read first: notebook 05 · EDGE section 3 · Lodge sections 3.3 and 3.4.

Symbols (axes: b batch · f motion tokens · k music tokens · d motion, m music features)
    x_t      noisy motion, normalised                                   (b, f, d)
    t        diffusion step                                             (b,)
    M        music features, standardised                               (b, N, m)
    frames   the frame of the song that each motion token belongs to    (f,)
    keep     False = pretend there is no music                          (b,)
    memory   what the layers listen to: music and other tokens          (b, k + ..., d_model)
    cond     step and music in one vector, for FiLM                     (b, d_model)
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.conditioning import BatchInvariantLinear, MusicEncoder, TimestepEncoder
from dancediff.nn.decoder import DecoderLayer


def check_shapes(**values: tuple[Tensor | None, tuple | None]) -> None:
    """Each value with the shape it should have; None: it should not be given.

    Raises: ValueError naming the argument.

    >>> check_shapes(t=(torch.zeros(3), (2,)))
    Traceback (most recent call last):
    ValueError: t has shape (3,); expected (2,)
    """
    for name, (value, expected) in values.items():
        have = None if value is None else tuple(value.shape)
        if have != expected:
            raise ValueError(f"{name} has shape {have}; expected {expected}")


class SoloLayer(DecoderLayer):
    r"""EDGE's layer for one dancer: self-attention, cross-attention, feed-forward, each with FiLM.

    $$h \leftarrow h + \text{FiLM}_i(\text{block}_i(\text{LN}_i(h)), c), \qquad i = 1 \dots 3$$

    Source: EDGE section 3; Lodge keeps it.  Differs: the tokens need not follow one another, since
    dance primitives are 8 frames here and 8 frames there: ``frames`` says where each one sits.

    Shapes: h (b, f, d), memory (b, k, d), cond (b, d), frames (f,), memory_frames (k,)
    -> (b, f, d).

    >>> layer = SoloLayer(16, num_heads=2, ff_dim=32)
    >>> h, memory, cond = torch.randn(2, 5, 16), torch.randn(2, 7, 16), torch.randn(2, 16)
    >>> layer(h, memory, cond, torch.arange(5), torch.arange(7)).shape
    torch.Size([2, 5, 16])
    """

    def forward(
        self, h: Tensor, memory: Tensor, cond: Tensor, frames: Tensor, memory_frames: Tensor
    ) -> Tensor:
        """Run the three blocks in turn."""
        blocks = (
            lambda x: self.self_attention(x, x, frames, frames),
            lambda x: self.cross_attention(x, memory, frames, memory_frames),
            self.feed_forward,
        )
        for block, norm, film in zip(blocks, self.norms, self.films, strict=True):
            h = h + film(self.dropout(block(norm(h))), cond)
        return h


class Trunk(nn.Module):
    r"""Noisy motion and a song in, what the decoder knows about the clean motion out.

    Source: EDGE section 3; Lodge's two stages build on it.  Differs: rotary positions are turned
    after the projection, head by head, as everywhere here; ``pool`` frames of music may share one
    token (their features side by side, so that a beat keeps its frame).

    Shapes: see the module's symbols.

    >>> trunk = Trunk(16, 2, 1, 32, motion_dim=139, music_dim=35, music_frames=12, pool=3)
    >>> music, steps, cond = trunk.conditions(torch.randn(2, 12, 35), torch.tensor([10, 900]))
    >>> trunk(torch.randn(2, 8, 139), [music, steps], cond, torch.arange(8)).shape
    torch.Size([2, 8, 139])
    """

    def __init__(
        self,
        d_model: int,
        num_heads: int,
        num_layers: int,
        ff_dim: int,
        *,
        motion_dim: int,
        music_dim: int,
        music_frames: int,
        pool: int = 1,
        dropout: float = 0.0,
        with_guess: bool = False,
    ):
        """``with_guess``: a linear guess and the noise it leaves are embedded beside the motion."""
        super().__init__()
        if pool < 1 or music_frames % pool:
            raise ValueError(f"pool={pool} must divide music_frames={music_frames}")
        d = d_model
        self.pool = pool
        self.embed = nn.Linear(motion_dim, d)
        self.embed_guess = nn.Linear(motion_dim, d, bias=False) if with_guess else None
        self.embed_noise = nn.Linear(motion_dim, d, bias=False) if with_guess else None
        self.timestep = TimestepEncoder(d)
        self.music = MusicEncoder(
            music_dim * pool, d, num_heads=num_heads, ff_dim=ff_dim, dropout=dropout
        )
        self.pooled_music = nn.Sequential(
            nn.LayerNorm(d), BatchInvariantLinear(d, d), nn.SiLU(), BatchInvariantLinear(d, d)
        )
        self.null_music = nn.Parameter(torch.randn(1, music_frames // pool, d))
        self.null_pooled = nn.Parameter(torch.randn(1, d))
        self.norm_memory = nn.LayerNorm(d)
        self.layers = nn.ModuleList(
            SoloLayer(d, num_heads=num_heads, ff_dim=ff_dim, dropout=dropout)
            for _ in range(num_layers)
        )
        self.out = nn.Linear(d, motion_dim)
        middle = pool * torch.arange(music_frames // pool) + (pool - 1) / 2
        self.register_buffer("token_frames", middle, persistent=False)

    def conditions(
        self, M: Tensor, t: Tensor, keep: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Music tokens (b, k, d_model), two step tokens (b, 2, d_model), FiLM's (b, d_model)."""
        music = self.music(rearrange(M, "b (k p) m -> b k (p m)", p=self.pool))
        pooled = self.pooled_music(music.mean(dim=1))
        if keep is not None:
            music = torch.where(keep[:, None, None], music, self.null_music)
            pooled = torch.where(keep[:, None], pooled, self.null_pooled.to(pooled.dtype))
        step, step_tokens = self.timestep(t)
        return music.float(), step_tokens.float(), (step + pooled).float()

    def forward(
        self, x_t: Tensor, memory: list[Tensor], cond: Tensor, frames: Tensor, **inputs
    ) -> Tensor:
        """`tokens`, read out."""
        return self.read(self.tokens(x_t, memory, cond, frames, **inputs))

    def read(self, h: Tensor) -> Tensor:
        """From tokens (b, f, d_model) to what the network puts out (b, f, d)."""
        with torch.autocast(h.device.type, enabled=False):  # millimetres need float32
            return self.out(h.float())

    def tokens(
        self,
        x_t: Tensor,
        memory: list[Tensor],
        cond: Tensor,
        frames: Tensor,
        *,
        guess: Tensor | None = None,
        noise: Tensor | None = None,
        waves: Tensor | None = None,
    ) -> Tensor:
        """``memory``: the music tokens first, then any that belong to no frame.

        ``guess`` and ``noise`` (b, f, d): with preconditioning. ``waves`` (b, f, d_model), where
        given, are added to the tokens.
        """
        h = self.embed(x_t)
        if guess is not None:
            h = h + self.embed_guess(guess) + self.embed_noise(noise)
        if waves is not None:
            h = h + waves
        h = h.float()  # the residual stream stays in float32 under autocast
        memory = self.norm_memory(torch.cat(memory, dim=1))
        # Only music belongs to a frame. Frame 0 means "not turned" to the other tokens.
        memory_frames = self.token_frames.new_zeros(memory.shape[1])
        memory_frames[: len(self.token_frames)] = self.token_frames
        for layer in self.layers:
            h = layer(h, memory, cond, frames, memory_frames)
        return h
