r"""Conditions of a decoder: noise level and music, as tokens to attend to and as one FiLM vector.

Read first: notebooks 05 and 08 · EDGE section 3 · Perez et al. 2018 (FiLM) eq. 2.

Symbols (axes: b batch · f frames · k music tokens · m music features · d channels
         p frames that share a music token)
    t      the noise level, 0 (clean) .. T-1 (noise)     (b,)
    M      music features, standardised                   (b, f, m)
    cond   all conditions in one vector                   (b, d)
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.nn.attention import Attention, FeedForward, full_precision


class BatchInvariantLinear(nn.Linear):
    """`torch.nn.Linear` whose rows are the same to the last bit, however many there are.

    A library multiplies one row by another routine than sixteen, and sums in another order.
    Sampling multiplies such a last digit by a thousand, so a segment would depend on what is danced
    beside it. So rows are multiplied one by one, on a CPU and without gradients; elsewhere as
    usual. Layers that see hundreds of frames a row take one routine anyway.

    Shapes: x (b, ..., i) -> (b, ..., o).

    >>> layer, x = BatchInvariantLinear(64, 32).requires_grad_(False), torch.randn(16, 64)
    >>> torch.equal(layer(x)[:1], layer(x[:1]))
    True
    """

    def forward(self, x: Tensor) -> Tensor:
        """As many products as there are rows."""
        if x.device.type != "cpu" or len(x) == 1 or (torch.is_grad_enabled() and self._learns(x)):
            return super().forward(x)
        return torch.cat([super(BatchInvariantLinear, self).forward(row) for row in x.split(1)])

    def _learns(self, x: Tensor) -> bool:
        return x.requires_grad or self.weight.requires_grad


class FiLM(nn.Module):
    r"""Scale and shift every channel by amounts read off the condition.

    $$\text{FiLM}(h, c) = (1 + \gamma(c)) \odot h + \beta(c), \quad
      [\gamma, \beta] = W\,\text{Mish}(c)$$

    Source: Perez et al. eq. 2; EDGE places it on each sub-layer's output, TCDiff++ follows.

    Shapes: h (b, ..., d), cond (b, d) -> like h.

    >>> import torch
    >>> FiLM(8)(torch.randn(2, 5, 3, 8), torch.randn(2, 8)).shape
    torch.Size([2, 5, 3, 8])
    """

    def __init__(self, d_model: int):
        """One learned map from the condition to 2 d numbers."""
        super().__init__()
        self.scale_and_shift = nn.Sequential(nn.Mish(), BatchInvariantLinear(d_model, 2 * d_model))

    def forward(self, h: Tensor, cond: Tensor) -> Tensor:
        """Broadcast over every axis between batch and channels."""
        b, d = cond.shape
        both = self.scale_and_shift(cond).reshape(b, *(1,) * (h.ndim - 2), 2 * d)
        scale, shift = both.chunk(2, dim=-1)
        return shift.addcmul(1 + scale, h)


class ConcatSquashLinear(nn.Module):
    r"""A linear layer whose output a condition gates and shifts.

    $$\text{CSL}(x, c) = (W x + b) \odot \sigma(W_g c + b_g) + W_b c$$

    Source: TCDiff++ section 4.2, after Grathwohl et al. 2019 (FFJORD).

    Shapes: x (..., d_in), c (..., d_cond) -> (..., d_out).

    >>> ConcatSquashLinear(4, 6, 2)(torch.randn(3, 4), torch.randn(3, 2)).shape
    torch.Size([3, 6])
    """

    def __init__(self, d_in: int, d_out: int, d_cond: int):
        """Gate and shift start at zero: first the layer is half a linear map."""
        super().__init__()
        self.linear = nn.Linear(d_in, d_out)
        self.gate = nn.Linear(d_cond, d_out)
        self.shift = nn.Linear(d_cond, d_out, bias=False)
        for parameter in (*self.gate.parameters(), *self.shift.parameters()):
            nn.init.zeros_(parameter)

    def forward(self, x: Tensor, c: Tensor) -> Tensor:
        """See the equation."""
        return self.linear(x) * torch.sigmoid(self.gate(c)) + self.shift(c)


def sinusoid(t: Tensor, channels: int) -> Tensor:
    r"""Sines and cosines of t at geometrically spaced frequencies from 1 to 1/10000.

    Source: DDPM appendix B; halves (all sines, then all cosines) as in EDGE.

    Shapes: t (b,) -> (b, channels).
    Raises: ValueError for channels that are not an even number.

    >>> sinusoid(torch.tensor([0]), 4)
    tensor([[0., 0., 1., 1.]])
    """
    half = channels // 2
    if channels % 2:
        raise ValueError(f"channels={channels} must be even: half of them are sines")
    frequency = torch.exp(-math.log(1e4) * torch.arange(half, device=t.device) / max(half - 1, 1))
    angle = t[:, None].float() * frequency
    return torch.cat([angle.sin(), angle.cos()], dim=-1)


class TimestepEncoder(nn.Module):
    """Turn a step t into one vector for FiLM and two tokens for the memory.

    Source: EDGE; TCDiff++ keeps it.

    Shapes: t (b,) -> (b, d_model), (b, 2, d_model).

    >>> vector, tokens = TimestepEncoder(16)(torch.tensor([0, 500, 999]))
    >>> vector.shape, tokens.shape
    (torch.Size([3, 16]), torch.Size([3, 2, 16]))
    """

    def __init__(self, d_model: int):
        """A hidden layer four times as wide, then two heads."""
        super().__init__()
        self.d_model = d_model
        self.hidden = nn.Sequential(BatchInvariantLinear(d_model, 4 * d_model), nn.Mish())
        self.to_vector = BatchInvariantLinear(4 * d_model, d_model)
        self.to_tokens = BatchInvariantLinear(4 * d_model, 2 * d_model)

    def forward(self, t: Tensor) -> tuple[Tensor, Tensor]:
        """Both forms of the step."""
        hidden = self.hidden(sinusoid(t, self.d_model).to(self.to_vector.weight))
        return self.to_vector(hidden), self.to_tokens(hidden).unflatten(-1, (2, -1))


class MusicEncoder(nn.Module):
    """Let every frame of the music know what comes before and after it.

    Source: EDGE (a linear map, then two pre-norm transformer encoder layers); TCDiff++ keeps it.
    ``pool`` frames may share one token, their features side by side, so that a beat keeps its
    frame: Lodge's downsampling.

    Shapes: M (b, f, m) -> (b, f / pool, d_model).

    >>> MusicEncoder(35, 16, num_heads=2, ff_dim=32)(torch.randn(2, 9, 35)).shape
    torch.Size([2, 9, 16])
    """

    def __init__(
        self,
        music_dim: int,
        d_model: int,
        *,
        num_heads: int,
        ff_dim: int,
        pool: int = 1,
        num_layers: int = 2,
        dropout: float = 0.0,
    ):
        """One map into the model's width and ``num_layers`` x (attention, feed-forward)."""
        super().__init__()
        self.pool = pool
        self.linear = nn.Linear(music_dim * pool, d_model)
        self.attentions = nn.ModuleList(Attention(d_model, num_heads) for _ in range(num_layers))
        self.feed_forwards = nn.ModuleList(
            FeedForward(d_model, ff_dim, dropout) for _ in range(num_layers)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(d_model) for _ in range(2 * num_layers))
        self.dropout = nn.Dropout(dropout)
        self._cached: list[tuple[Tensor, Tensor]] | None = None  # None: nothing is cached

    def forward(self, M: Tensor) -> Tensor:
        """Standardised music features in, one token per frame out."""
        cached = self._cached  # another thread may put another list in its place
        if cached is None:
            return self._encode(M)
        for known, h in cached:
            if _same_place(M, known):
                return h
        h = self._encode(M)
        self._cached = [*cached[1 - CACHED :], (M, h)]
        return h

    def _encode(self, M: Tensor) -> Tensor:
        M = rearrange(M, "b (k p) m -> b k (p m)", p=self.pool)
        frames = torch.arange(M.shape[1], device=M.device)
        h = full_precision(self.linear(M))  # the residual stream stays in float32 under autocast
        for i, (attend, feed_forward) in enumerate(
            zip(self.attentions, self.feed_forwards, strict=True)
        ):
            x = self.norms[2 * i](h)
            h = h + self.dropout(attend(x, x, frames, frames))
            h = h + self.dropout(feed_forward(self.norms[2 * i + 1](h)))
        return h


def _same_place(a: Tensor, b: Tensor) -> bool:
    """Are these the same numbers in memory? b is cached, so nothing else can lie in its place."""
    return (a.data_ptr(), a.shape, a.stride()) == (b.data_ptr(), b.shape, b.stride())


CACHED = 16  # encodings that an encoder keeps: the parts of a dance of five minutes, no more


@contextmanager
def cached_music(model: nn.Module) -> Iterator[None]:
    """Inside, every `MusicEncoder` of a model encodes the same music only once.

    A sampler asks for the same segment at every step. Neither weights nor music, which is known by
    its place in memory, may change meanwhile.

    >>> encoder = MusicEncoder(35, 16, num_heads=2, ff_dim=32)
    >>> M = torch.randn(2, 9, 35)
    >>> with cached_music(encoder):
    ...     encoder(M) is encoder(M)
    True
    >>> encoder(M) is encoder(M)
    False
    """
    encoders = [part for part in model.modules() if isinstance(part, MusicEncoder)]
    for encoder in encoders:
        encoder._cached = []
    try:
        yield
    finally:
        for encoder in encoders:
            encoder._cached = None


class MusicConditioning(nn.Module):
    """The conditions that all decoders share; a decoder inherits from it.

    Source: EDGE; TCDiff++ and Lodge keep it. Rows whose music is masked get learned null tokens
    instead (classifier-free guidance).

    >>> front = MusicConditioning(16, num_heads=2, ff_dim=32, music_dim=35, music_frames=12, pool=3)
    >>> music, steps, cond = front.condition(torch.tensor([9]), Conditions(torch.randn(1, 12, 35)))
    >>> music.shape, steps.shape, cond.shape
    (torch.Size([1, 4, 16]), torch.Size([1, 2, 16]), torch.Size([1, 16]))
    """

    def __init__(
        self,
        d_model: int,
        *,
        num_heads: int,
        ff_dim: int,
        music_dim: int,
        music_frames: int,
        pool: int = 1,
        dropout: float = 0.0,
    ):
        """Learned: both encoders, and tokens and a vector that stand for no music."""
        super().__init__()
        if pool < 1 or music_frames % pool:
            raise ValueError(f"pool={pool} must divide music_frames={music_frames}")
        self.timestep = TimestepEncoder(d_model)
        self.music = MusicEncoder(
            music_dim, d_model, num_heads=num_heads, ff_dim=ff_dim, pool=pool, dropout=dropout
        )
        self.pooled_music = nn.Sequential(
            nn.LayerNorm(d_model),
            BatchInvariantLinear(d_model, d_model),
            nn.SiLU(),
            BatchInvariantLinear(d_model, d_model),
        )
        self.null_music = nn.Parameter(torch.randn(1, music_frames // pool, d_model))
        self.null_pooled = nn.Parameter(torch.randn(1, d_model))

    def condition(self, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor, Tensor]:
        """Music tokens (b, k, d_model), step tokens (b, 2, d_model), FiLM's vector (b, d_model)."""
        mask = conditions.music_mask
        music = self.music(conditions.music)
        pooled = self.pooled_music(music.mean(dim=1))
        music = torch.where(mask[:, None, None], music, self.null_music[:, : music.shape[1]])
        pooled = torch.where(mask[:, None], pooled, self.null_pooled.to(pooled.dtype))
        step, step_tokens = self.timestep(t)
        return full_precision(music), full_precision(step_tokens), full_precision(step + pooled)
