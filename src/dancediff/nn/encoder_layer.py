r"""A transformer encoder's layer, in which a mask may hide tokens from each other.

Read first: Vaswani et al. 2017 section 3.

Symbols (axes: b batch · l tokens · h heads · d channels · c channels of a head)
    h      what the network knows about each token                        (b, l, d)
    mask   True where a token (row) sees another one (column), or numbers
           that are added to the logits                                   (l, l)
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.attention import FeedForward, attend


def causal_mask(num_tokens: int, device=None) -> Tensor:
    """Every token sees itself and those before it, (l, l).

    >>> causal_mask(3).int().tolist()
    [[1, 0, 0], [1, 1, 0], [1, 1, 1]]
    """
    return torch.ones(num_tokens, num_tokens, dtype=torch.bool, device=device).tril()


class SelfAttention(nn.Module):
    r"""Multi-head attention without positions: those are added to the tokens.

    $$\text{softmax}\Big(\frac{Q K^\top}{\sqrt c} + \text{mask}\Big) V$$

    Source: Vaswani et al. eq. 1, with c channels a head.

    Shapes: h (b, l, d), mask (l, l) -> (b, l, d).
    Raises: ValueError when the heads do not divide the channels.

    >>> SelfAttention(16, num_heads=2)(torch.randn(3, 5, 16), causal_mask(5)).shape
    torch.Size([3, 5, 16])
    """

    def __init__(self, d_model: int, num_heads: int, *, qkv_bias: bool = True):
        """Learned: queries, keys and values in one map, and out."""
        super().__init__()
        if d_model % num_heads:
            raise ValueError(f"d_model={d_model} must be a multiple of num_heads={num_heads}")
        self.num_heads = num_heads
        self.qkv = nn.Linear(d_model, 3 * d_model, bias=qkv_bias)
        self.out = nn.Linear(d_model, d_model)

    def forward(self, h: Tensor, mask: Tensor | None = None) -> Tensor:
        """Let every token gather what it needs from those that it sees."""
        Q, K, V = rearrange(self.qkv(h), "b l (three h c) -> three b h l c", three=3,
                            h=self.num_heads)  # fmt: skip
        return self.out(rearrange(attend(Q, K, V, mask), "b h l c -> b l (h c)"))


class EncoderLayer(nn.Module):
    r"""Self-attention and feed-forward, each behind a LayerNorm and around it a residual.

    $$h \leftarrow h + \text{attention}(\text{LN}_1(h)), \quad
      h \leftarrow h + \text{feed-forward}(\text{LN}_2(h))$$

    Shapes: h (b, l, d), mask (l, l) -> (b, l, d).

    >>> EncoderLayer(16, num_heads=2, ff_dim=32)(torch.randn(3, 5, 16)).shape
    torch.Size([3, 5, 16])
    """

    def __init__(
        self,
        d_model: int,
        *,
        num_heads: int,
        ff_dim: int,
        dropout: float = 0.0,
        qkv_bias: bool = True,
    ):
        super().__init__()
        self.norm_attention, self.norm_feed_forward = nn.LayerNorm(d_model), nn.LayerNorm(d_model)
        self.attention = SelfAttention(d_model, num_heads, qkv_bias=qkv_bias)
        self.feed_forward = FeedForward(d_model, ff_dim, dropout)
        self.dropout = nn.Dropout(dropout)

    def forward(self, h: Tensor, mask: Tensor | None = None) -> Tensor:
        """See the equations."""
        h = h + self.dropout(self.attention(self.norm_attention(h), mask))
        return h + self.dropout(self.feed_forward(self.norm_feed_forward(h)))
