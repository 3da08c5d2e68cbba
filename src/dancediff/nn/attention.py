r"""Attention that knows which frame a token belongs to.

Read first: notebook 05 · Vaswani et al. 2017 eq. 1 · Su et al. 2021 (RoPE) eq. 34.

Symbols (axes: b batch · h heads · l tokens that ask · k tokens that answer · c channels of a head)
    x, memory   tokens                                     (b, l, d_model), (b, k, d_model)
    frames      which frame each token belongs to          (l,), (k,)
    Q, K, V     queries, keys, values                      (b, h, l | k, c)
"""

import math

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

ROPE_BASE = 10_000.0  # EDGE and the RoPE paper


def full_precision(x: Tensor) -> Tensor:
    """In float32, whatever autocast made of them; numbers in double stay so.

    >>> [full_precision(torch.zeros(1, dtype=d)).dtype for d in (torch.bfloat16, torch.float64)]
    [torch.float32, torch.float64]
    """
    return x if x.dtype == torch.float64 else x.float()


def rope_frequencies(channels: int) -> Tensor:
    r"""Turning speed of every channel pair, in radians per frame: $\theta_i = 10000^{-2i/c}$.

    >>> rope_frequencies(4)
    tensor([1.0000, 0.0100])
    """
    return ROPE_BASE ** (-torch.arange(0, channels, 2) / channels)


def rope_angles(frames: Tensor, frequencies: Tensor) -> Tensor:
    """Angle of every channel pair at every frame: (l,), (c / 2,) -> (l, c / 2) radians.

    >>> rope_angles(torch.tensor([0, 3]), rope_frequencies(4))
    tensor([[0.0000, 0.0000],
            [3.0000, 0.0300]])
    """
    return frames[:, None].float() * frequencies


def rotate(x: Tensor, angles: Tensor) -> Tensor:
    r"""Turn channel pair i of the token at frame f by $f\theta_i$ (rotary position embedding).

    A turned query times a turned key depends on the content and on *how far apart* the two frames
    are, never on where they are. Frame 0 leaves a token as it is.

    Source: RoPE eq. 34.  Differs: EDGE and TCDiff++ turn the layer's input before it is projected
    to Q and K, so that content and position get mixed; we turn Q and K themselves, head by head.

    Shapes: x (b, h, l, c), angles (l, c / 2) -> (b, h, l, c).

    >>> x = torch.randn(1, 1, 1, 8)
    >>> at = lambda f: rotate(x, rope_angles(torch.tensor([f]), rope_frequencies(8)))
    >>> torch.allclose((at(3) * at(5)).sum(), (at(10) * at(12)).sum(), atol=1e-5)
    True
    """
    cos, sin = angles.cos().to(x.dtype), angles.sin().to(x.dtype)
    first, second = x.chunk(2, dim=-1)
    return torch.cat([first * cos - second * sin, second * cos + first * sin], dim=-1)


class Attention(nn.Module):
    r"""Multi-head attention with rotary frame positions.

    $$\text{softmax}\Big(\frac{R_f Q\,(R_g K)^\top}{\sqrt c}\Big) V$$

    Source: Vaswani et al. eq. 1 with RoPE; used by every layer of TCDiff++ section 4.1.

    Shapes: x (b, l, d_model), memory (b, k, d_model) -> (b, l, d_model).

    >>> attend = Attention(16, num_heads=2)
    >>> x = torch.randn(3, 10, 16)
    >>> attend(x, x, torch.arange(10), torch.arange(10)).shape
    torch.Size([3, 10, 16])
    """

    frequencies: Tensor

    def __init__(self, d_model: int, num_heads: int):
        """Learned: query, key with value, and out, each with a bias."""
        super().__init__()
        if d_model % (2 * num_heads):
            raise ValueError(f"d_model={d_model} must be a multiple of 2 * num_heads={num_heads}")
        self.num_heads, self.channels = num_heads, d_model // num_heads
        self.query = nn.Linear(d_model, d_model)
        self.key_value = nn.Linear(d_model, 2 * d_model)
        self.out = nn.Linear(d_model, d_model)
        self.register_buffer("frequencies", rope_frequencies(self.channels), persistent=False)

    def project(self, x: Tensor, memory: Tensor, x_frames: Tensor, memory_frames: Tensor):
        """Turned queries (b, h, l, c), turned keys and plain values (b, h, k, c)."""
        Q = rearrange(self.query(x), "b l (h c) -> b h l c", h=self.num_heads)
        K, V = rearrange(
            self.key_value(memory), "b k (two h c) -> two b h k c", two=2, h=self.num_heads
        )
        Q = rotate(Q, rope_angles(x_frames, self.frequencies))
        K = rotate(K, rope_angles(memory_frames, self.frequencies))
        return Q, K, V

    def weights(self, x: Tensor, memory: Tensor, x_frames: Tensor, memory_frames: Tensor):
        """The attention weights (b, h, l, k), to look at; `forward` need not build them."""
        Q, K, _ = self.project(x, memory, x_frames, memory_frames)
        return (Q @ K.mT / math.sqrt(self.channels)).softmax(-1)

    def forward(self, x: Tensor, memory: Tensor, x_frames: Tensor, memory_frames: Tensor) -> Tensor:
        """Let every token of x gather what it needs from memory."""
        Q, K, V = self.project(x, memory, x_frames, memory_frames)
        return self.out(rearrange(attend(Q, K, V), "b h l c -> b l (h c)"))


def attend(Q: Tensor, K: Tensor, V: Tensor, mask: Tensor | None = None) -> Tensor:
    """Softmax attention, the fastest way there is.

    ``mask`` (l, k): True where a query sees a key, or numbers that are added to the logits.

    That is torch's fused kernel, but for its backward pass in bfloat16 on a CPU: written out, the
    same takes half the time (measured with torch 2.13 and AMX).
    """
    if not (Q.dtype == torch.bfloat16 and Q.device.type == "cpu" and torch.is_grad_enabled()):
        return F.scaled_dot_product_attention(Q, K, V, attn_mask=mask)
    logits = (Q / math.sqrt(Q.shape[-1])) @ K.mT
    if mask is not None:
        hidden = mask.dtype == torch.bool
        logits = logits.masked_fill(~mask, -math.inf) if hidden else logits + mask
    return logits.softmax(-1) @ V


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
