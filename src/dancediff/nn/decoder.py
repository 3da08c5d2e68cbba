r"""EDGE's transformer decoder; TCDiff++ and Lodge build theirs from the same layer.

Read first: notebook 05 · EDGE section 3 · TCDiff++ section 4.1.

Symbols (axes: b batch · l motion tokens · k memory tokens · d channels)
    h        what the network knows about each motion token   (b, l, d)
    memory   music and other conditions to attend to          (b, k, d)
    cond     step and music in one vector, for FiLM           (b, d)
    frames   the frame that each token belongs to             (l,), (k,)
"""

from collections.abc import Callable, Iterable
from typing import Any

import torch
import torch.nn.functional as F
from einops import rearrange, repeat
from torch import Tensor, nn

from dancediff.nn.attention import Attention, FeedForward, full_precision
from dancediff.nn.conditioning import FiLM, MusicConditioning


class DecoderLayer(nn.Module):
    r"""Self-attention, cross-attention, feed-forward, each with a LayerNorm and FiLM of its own.

    $$h \leftarrow h + \text{FiLM}_i(\text{block}_i(\text{LN}_i(h)), c), \qquad i = 1 \dots 3$$

    Source: EDGE section 3.  Differs: tokens need not follow one another in time; ``frames`` says
    where each one is.

    Shapes: see the module's symbols; returns (b, l, d).

    >>> layer = DecoderLayer(16, num_heads=2, ff_dim=32)
    >>> h, memory, cond = torch.randn(2, 5, 16), torch.randn(2, 7, 16), torch.randn(2, 16)
    >>> layer(h, memory, cond, torch.arange(5), torch.arange(7)).shape
    torch.Size([2, 5, 16])
    """

    num_blocks = 3

    def __init__(self, d_model: int, *, num_heads: int, ff_dim: int, dropout: float = 0.0):
        super().__init__()
        self.self_attention = Attention(d_model, num_heads)
        self.cross_attention = Attention(d_model, num_heads)
        self.feed_forward = FeedForward(d_model, ff_dim, dropout)
        self.norms = nn.ModuleList(nn.LayerNorm(d_model) for _ in range(self.num_blocks))
        self.films = nn.ModuleList(FiLM(d_model) for _ in range(self.num_blocks))
        self.dropout = nn.Dropout(dropout)

    def forward(
        self, h: Tensor, memory: Tensor, cond: Tensor, frames: Tensor, memory_frames: Tensor
    ) -> Tensor:
        """Run the three blocks in turn."""
        return self.run(h, cond, self.blocks(memory, frames, memory_frames))

    def blocks(self, memory: Tensor, frames: Tensor, memory_frames: Tensor) -> list[Callable]:
        """The blocks as functions of h."""
        return [
            lambda h: self.self_attention(h, h, frames, frames),
            lambda h: self.cross_attention(h, memory, frames, memory_frames),
            self.feed_forward,
        ]

    def run(self, h: Tensor, cond: Tensor, blocks: Iterable[Callable]) -> Tensor:
        """See the equation."""
        for block, norm, film in zip(blocks, self.norms, self.films, strict=True):
            h = h + film(self.dropout(block(norm(h))), cond)
        return h


def token_frames(h: Tensor) -> Tensor:
    """The frame that each token of (b, (f n), d) belongs to: shared by all dancers.

    >>> token_frames(torch.zeros(1, 2, 3, 8)).tolist()
    [0, 0, 1, 1, 2, 2]
    """
    return repeat(torch.arange(h.shape[2], device=h.device), "f -> (f n)", n=h.shape[1])


def frames_of_memory(num_tokens: int, music_frames: Tensor, *, first: int = 0) -> Tensor:
    """The frame of each memory token: only music, from the ``first`` token on, belongs to frames.

    Frame 0 means "not turned" to the other tokens.

    >>> frames_of_memory(6, torch.arange(3), first=1).tolist()
    [0, 0, 1, 2, 0, 0]
    """
    frames = music_frames.new_zeros(num_tokens)
    frames[first : first + len(music_frames)] = music_frames
    return frames


def read_out(out: nn.Linear, h: Tensor) -> Tensor:
    """From tokens (..., d_model) to motion (..., d), in float32 or double: millimetres need it."""
    with torch.autocast(h.device.type, enabled=False):
        return out(full_precision(h))


class FusionProjection(nn.Module):
    r"""Fusion Projection (FP): a three-layer network over all dancers of one frame, side by side.

    $$[h_1, \dots, h_C] \leftarrow W_3\,\text{ReLU}(W_2\,\text{ReLU}(W_1\,[h_1, \dots, h_C]))$$

    Every place in the row has its own weights: this is where left and right become different.

    Source: TCDiff; TCDiff++ section 4.1 and figure 3; no residual and no norm, as in the released
    code.  Differs: the papers train one model per group size; here the row has ``max_dancers``
    places, and those behind the last dancer count as zeros.

    Shapes: h (b, n, f, d_model), n <= max_dancers -> the same.
    Raises: ValueError for more dancers.

    >>> fp = FusionProjection(max_dancers=5, d_model=8, hidden=16)
    >>> h = torch.randn(1, 3, 2, 8)
    >>> padded = torch.cat([h, torch.zeros(1, 2, 2, 8)], dim=1)
    >>> torch.allclose(fp(h), fp(padded)[:, :3], atol=1e-6)
    True
    """

    def __init__(self, max_dancers: int, d_model: int, hidden: int):
        """Learned: three maps, started so that the signal keeps its size (He et al. 2015).

        Nothing leads around this block, so what torch's default start would shrink here is lost.
        """
        super().__init__()
        self.into = nn.Linear(max_dancers * d_model, hidden)
        self.middle = nn.Linear(hidden, hidden)
        self.back = nn.Linear(hidden, max_dancers * d_model)
        for layer in (self.into, self.middle, self.back):
            nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
            nn.init.zeros_(layer.bias)

    def forward(self, h: Tensor) -> Tensor:
        """Mix across dancers, never across frames."""
        n, d = h.shape[1], h.shape[3]
        if n * d > self.into.in_features:
            raise ValueError(f"h has {n} dancers; at most {self.into.in_features // d} fit")
        row = rearrange(h, "b n f d -> b f (n d)")
        # Zeros times weights are zeros: use only the columns that meet somebody.
        x = F.relu(F.linear(row, self.into.weight[:, : n * d], self.into.bias))
        x = F.relu(self.middle(x))
        row = F.linear(x, self.back.weight[: n * d], self.back.bias[: n * d])
        return rearrange(row, "b f (n d) -> b n f d", n=n)


class DanceDecoder(MusicConditioning):
    r"""Noisy motion and a song in, the clean motion of one dancer out.

    Source: EDGE section 3; Lodge's two stages build on it.  Differs: rotary positions are turned
    after the projection, head by head, as everywhere here.

    Shapes: x_t (b, f, d), see the module's symbols.

    >>> from dancediff.diffusion.conditions import Conditions
    >>> sizes = {"num_heads": 2, "num_layers": 1, "ff_dim": 32, "music_frames": 12, "pool": 3}
    >>> decoder = DanceDecoder(16, motion_dim=139, music_dim=35, **sizes)
    >>> conditions = Conditions(torch.randn(2, 12, 35))
    >>> music, steps, cond = decoder.condition(torch.tensor([10, 900]), conditions)
    >>> h = decoder.embed(torch.randn(2, 8, 139))
    >>> decoder.read(decoder(h, [music, steps], cond, torch.arange(8))).shape
    torch.Size([2, 8, 139])
    """

    music_token_frames: Tensor

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
    ):
        """Learned: the conditions' encoders, maps into and out of the model, the layers."""
        blocks: dict[str, Any] = {"num_heads": num_heads, "ff_dim": ff_dim, "dropout": dropout}
        super().__init__(
            d_model, music_dim=music_dim, music_frames=music_frames, pool=pool, **blocks
        )
        self.embed = nn.Linear(motion_dim, d_model)
        self.norm_memory = nn.LayerNorm(d_model)
        self.layers = nn.ModuleList(DecoderLayer(d_model, **blocks) for _ in range(num_layers))
        self.out = nn.Linear(d_model, motion_dim)
        middle = pool * torch.arange(music_frames // pool) + (pool - 1) / 2
        self.register_buffer("music_token_frames", middle, persistent=False)

    @classmethod
    def of(cls, c: Any, music_frames: int, pool: int = 1) -> "DanceDecoder":
        """Of the sizes in a model's config."""
        sizes = {"motion_dim": c.motion_dim, "music_dim": c.music_dim, "dropout": c.dropout}
        sizes |= {"music_frames": music_frames, "pool": pool}
        return cls(c.d_model, c.num_heads, c.num_layers, c.ff_dim, **sizes)

    def forward(self, h: Tensor, memory: list[Tensor], cond: Tensor, frames: Tensor) -> Tensor:
        """All layers, from embedded motion to its features, both (b, f, d_model).

        ``memory``: the music tokens first, then any that belong to no frame.
        """
        h = full_precision(h)  # the residual stream stays in float32 under autocast
        tokens = self.norm_memory(torch.cat(memory, dim=1))
        of_music = self.music_token_frames[: memory[0].shape[1]]
        of_tokens = frames_of_memory(tokens.shape[1], of_music)
        for layer in self.layers:
            h = layer(h, tokens, cond, frames, of_tokens)
        return h

    def read(self, h: Tensor) -> Tensor:
        """From tokens (b, f, d_model) to motion (b, f, d)."""
        return read_out(self.out, h)


def check_group(x_t: Tensor, config: Any) -> None:
    """Refuse noisy motion that is no group (b, n, f, d) of a model with these sizes.

    Raises: ValueError naming its shape and what fits.
    """
    shape, c = tuple(x_t.shape), config
    fits = len(shape) == 4 and shape[3] == c.motion_dim  # an axis too few is the batch's
    if not (fits and 1 <= shape[1] <= c.max_dancers and 1 <= shape[2] <= c.num_frames):
        raise ValueError(
            f"x_t has shape {shape}; expected (b, n, f, d) with n <= {c.max_dancers}, "
            f"f <= {c.num_frames}, d = {c.motion_dim}"
        )


def check_shapes(**values: tuple[Tensor | None, tuple | None]) -> None:
    """Each value that a decoder is given with the shape it should have; None: it should be absent.

    Raises: ValueError naming the argument.

    >>> check_shapes(t=(torch.zeros(3), (2,)))
    Traceback (most recent call last):
    ValueError: t has shape (3,); expected (2,)
    """
    for name, (value, expected) in values.items():
        have = None if value is None else tuple(getattr(value, "shape", ()))  # a number has none
        if have != expected:
            raise ValueError(f"{name} has shape {have}; expected {expected}")
