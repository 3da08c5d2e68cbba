r"""One layer of a dance decoder: look at each other, remember, listen, think.

Read first: notebook 05 · TCDiff++ section 4.2 · EDGE section 3.

Symbols (axes: b batch · n dancers · f frames · k memory tokens · d channels)
    h         what the network knows about each dancer and frame   (b, n, f, d)
    memory    music and other conditions to listen to              (b, k, d)
    cond      step, music and swap mode in one vector              (b, d)
"""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from einops import rearrange, repeat
from torch import Tensor, nn

from dancediff.axes import from_tokens, to_tokens
from dancediff.nn.attention import Attention
from dancediff.nn.film import FiLM


class FeedForward(nn.Sequential):
    """The two-layer network applied to every token on its own.

    >>> FeedForward(8, 32)(torch.randn(2, 5, 8)).shape
    torch.Size([2, 5, 8])
    """

    def __init__(self, d_model: int, ff_dim: int, dropout: float = 0.0):
        super().__init__(
            nn.Linear(d_model, ff_dim),
            nn.GELU(),
            nn.Dropout(dropout),
            nn.Linear(ff_dim, d_model),
        )


def frame_of_tokens(n: int, f: int, device=None) -> Tensor:
    """The frame that each token of (b, (f n), d) belongs to: shared by all dancers.

    >>> frame_of_tokens(2, 3).tolist()
    [0, 0, 1, 1, 2, 2]
    """
    frames = repeat(torch.arange(f, device=device), "f -> 1 n f 1", n=n)
    return to_tokens(frames)[0, :, 0]


LAYERS = ("paper", "released")


class DecoderLayer(nn.Module):
    r"""Self-attention, state space model, cross-attention, feed-forward; each one optional to FiLM.

    $$h \leftarrow h + \text{FiLM}_i(\text{block}_i(\text{LN}_i(h)), c), \qquad i = 1 \dots 4$$

    Source: TCDiff++ section 4.2 (SA - SSM - CA - FF), pre-norm and FiLM on the branch as in EDGE.
    With ``ssm=None`` it is EDGE's layer with three blocks, which the released TCDiff++ code trains.
    Differs: that code can also put the state space model in the place of cross-attention, where it
    runs through the frames of all dancers, interleaved, as one stream, and memory is not heard.
    ``layer="released"`` is that, to compare.

    Shapes: h (b, n, f, d) -> (b, n, f, d).
    Raises: ValueError for an unknown ``layer``.

    >>> layer = DecoderLayer(16, num_heads=2, ff_dim=32)
    >>> h, memory, frames = torch.randn(2, 3, 5, 16), torch.randn(2, 7, 16), torch.arange(7)
    >>> layer(h, memory, torch.randn(2, 16), frames).shape
    torch.Size([2, 3, 5, 16])
    """

    def __init__(
        self,
        d_model: int,
        *,
        num_heads: int,
        ff_dim: int,
        ssm: nn.Module | None = None,
        layer: str = "paper",
        dropout: float = 0.0,
    ):
        """Blocks with one LayerNorm and one FiLM each; ``ssm`` maps (b, f, d) -> (b, f, d)."""
        super().__init__()
        if layer not in LAYERS:
            raise ValueError(f"layer={layer!r} is not one of {', '.join(map(repr, LAYERS))}")
        self.one_stream = layer == "released" and ssm is not None
        self.self_attention = Attention(d_model, num_heads)
        self.ssm = ssm
        self.cross_attention = (
            None if self.one_stream else Attention(d_model, num_heads, aligned=True)
        )
        self.feed_forward = FeedForward(d_model, ff_dim, dropout)
        num_blocks = 3 if ssm is None or self.one_stream else 4
        self.norms = nn.ModuleList(nn.LayerNorm(d_model) for _ in range(num_blocks))
        self.films = nn.ModuleList(FiLM(d_model) for _ in range(num_blocks))
        self.dropout = nn.Dropout(dropout)

    def forward(self, h: Tensor, memory: Tensor, cond: Tensor, memory_frames: Tensor) -> Tensor:
        """Run the blocks in turn. ``memory_frames`` (k,): the frame of each memory token."""
        b, n, f, _ = h.shape
        frames = frame_of_tokens(n, f, h.device)

        def self_attention(tokens):
            return self.self_attention(tokens, tokens, frames, frames)

        def own_time_axis(tokens):  # nobody's memory mixes with a neighbour's
            streams = rearrange(from_tokens(tokens, n), "b n f d -> (b n) f d")
            return to_tokens(rearrange(self.ssm(streams), "(b n) f d -> b n f d", b=b))

        def cross_attention(tokens):
            return self.cross_attention(tokens, memory, frames, memory_frames)

        blocks = [self_attention, own_time_axis, cross_attention, self.feed_forward]
        if self.ssm is None:
            blocks.remove(own_time_axis)
        if self.one_stream:
            blocks = [self_attention, self.ssm, self.feed_forward]
        tokens = to_tokens(h)
        for block, norm, film in zip(blocks, self.norms, self.films, strict=True):
            tokens = tokens + film(self.dropout(block(norm(tokens))), cond)
        return from_tokens(tokens, n)


class MusicEncoder(nn.Module):
    """Let every frame of the music know what comes before and after it.

    Source: EDGE (a linear map, then two pre-norm transformer encoder layers); TCDiff++ keeps it.

    Shapes: M (b, f, m) -> (b, f, d_model).

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
        num_layers: int = 2,
        dropout: float = 0.0,
    ):
        """One map into the model's width and ``num_layers`` x (attention, feed-forward)."""
        super().__init__()
        self.linear = nn.Linear(music_dim, d_model)
        self.attentions = nn.ModuleList(Attention(d_model, num_heads) for _ in range(num_layers))
        self.feed_forwards = nn.ModuleList(
            FeedForward(d_model, ff_dim, dropout) for _ in range(num_layers)
        )
        self.norms = nn.ModuleList(nn.LayerNorm(d_model) for _ in range(2 * num_layers))
        self.dropout = nn.Dropout(dropout)
        self._heard: list[tuple[Tensor, Tensor]] | None = None  # nothing is remembered

    def forward(self, M: Tensor) -> Tensor:
        """Standardised music features in, one token per frame out."""
        if self._heard is None:
            return self._encode(M)
        if not self._heard or not _same_place(M, self._heard[0][0]):
            self._heard = [(M, self._encode(M))]
        return self._heard[0][1]

    def _encode(self, M: Tensor) -> Tensor:
        frames = torch.arange(M.shape[1], device=M.device)
        h = self.linear(M).float()  # the residual stream stays in float32 under autocast
        for i, (attend, think) in enumerate(zip(self.attentions, self.feed_forwards, strict=True)):
            x = self.norms[2 * i](h)
            h = h + self.dropout(attend(x, x, frames, frames))
            h = h + self.dropout(think(self.norms[2 * i + 1](h)))
        return h


def _same_place(a: Tensor, b: Tensor) -> bool:
    """Are these the same numbers in memory? b is held, so nothing else can lie in its place."""
    return (a.data_ptr(), a.shape, a.stride()) == (b.data_ptr(), b.shape, b.stride())


@contextmanager
def music_heard_once(model: nn.Module) -> Iterator[None]:
    """While this lasts, every `MusicEncoder` of a model encodes the same music only once.

    A sampler asks for the same segment at every step. Weights must not change meanwhile.

    >>> encoder = MusicEncoder(35, 16, num_heads=2, ff_dim=32)
    >>> M = torch.randn(2, 9, 35)
    >>> with music_heard_once(encoder):
    ...     encoder(M) is encoder(M)
    True
    >>> encoder(M) is encoder(M)
    False
    """
    encoders = [part for part in model.modules() if isinstance(part, MusicEncoder)]
    for encoder in encoders:
        encoder._heard = []
    try:
        yield
    finally:
        for encoder in encoders:
            encoder._heard = None
