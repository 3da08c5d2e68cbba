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

from dancediff.lookup import table

ROPE_BASE = 10_000.0  # EDGE and the RoPE paper
ALIGNMENT = 8.0  # logit by which a token prefers its own frame at the start; ours


def rope_frequencies(channels: int) -> Tensor:
    r"""Turning speed of every channel pair, in radians per frame: $\theta_i = 10000^{-2i/c}$.

    >>> rope_frequencies(4)
    tensor([1.0000, 0.0100])
    """
    return ROPE_BASE ** (-torch.arange(0, channels, 2) / channels)


def rope_angles(frames: Tensor, channels: int) -> Tensor:
    """Angle of every channel pair at every frame: (l,) -> (l, c / 2) radians.

    >>> rope_angles(torch.tensor([0, 3]), 4)
    tensor([[0.0000, 0.0000],
            [3.0000, 0.0300]])
    """
    frames = frames[:, None].float()
    return frames * table(rope_frequencies, channels, like=frames)


def rotate(x: Tensor, angles: Tensor) -> Tensor:
    r"""Turn channel pair i of the token at frame f by $f\theta_i$ (rotary position embedding).

    A turned query times a turned key depends on the content and on *how far apart* the two frames
    are, never on where they are. Frame 0 leaves a token as it is.

    Source: RoPE eq. 34.  Differs: EDGE and TCDiff++ turn the layer's input before it is projected
    to Q and K, so that content and position get mixed; we turn Q and K themselves, head by head.

    Shapes: x (b, h, l, c), angles (l, c / 2) -> (b, h, l, c).

    >>> x = torch.randn(1, 1, 1, 8)
    >>> at = lambda f: rotate(x, rope_angles(torch.tensor([f]), 8))
    >>> torch.allclose((at(3) * at(5)).sum(), (at(10) * at(12)).sum(), atol=1e-5)
    True
    """
    cos, sin = angles.cos().to(x.dtype), angles.sin().to(x.dtype)
    first, second = x.chunk(2, dim=-1)
    return torch.cat([first * cos - second * sin, second * cos + first * sin], dim=-1)


class Attention(nn.Module):
    r"""Multi-head attention with rotary frame positions.

    $$\text{softmax}\Big(\frac{R_f Q\,(R_g K)^\top}{\sqrt c}\Big) V$$

    Source: Vaswani et al. eq. 1 with RoPE; used by every layer of TCDiff++ section 4.2.

    Shapes: x (b, l, d_model), memory (b, k, d_model) -> (b, l, d_model).

    >>> attend = Attention(16, num_heads=2)
    >>> x = torch.randn(3, 10, 16)
    >>> attend(x, x, torch.arange(10), torch.arange(10)).shape
    torch.Size([3, 10, 16])
    """

    def __init__(self, d_model: int, num_heads: int, *, aligned: bool = False):
        """Four learned maps: to queries, to keys, to values, and out.

        ``aligned=True`` starts with half of the heads looking at their own frame (`align`).
        """
        super().__init__()
        if d_model % (2 * num_heads):
            raise ValueError(f"d_model={d_model} must be a multiple of 2 * num_heads={num_heads}")
        self.num_heads = num_heads
        self.query = nn.Linear(d_model, d_model)
        self.key_value = nn.Linear(d_model, 2 * d_model)
        self.out = nn.Linear(d_model, d_model)
        if aligned:
            self.align()

    @property
    def channels(self) -> int:
        """Width of one head."""
        return self.query.out_features // self.num_heads

    @torch.no_grad()
    def align(self) -> None:
        r"""Start half of the heads at "listen to your own frame".

        Query and key biases get one shared vector v, so that before any content is learned the
        logit of frame f for frame g is $(R_f v)^\top(R_g v)/\sqrt c = \sum_i w\cos((f-g)\theta_i)$:
        largest at g = f. Without it the network has to discover from noise alone that 150 music
        tokens belong to 150 frames, which costs a small model most of its training. Slow pairs
        hardly turn within a window and would only add a constant: they get no bias. The other
        heads stay free to look at the whole song, the swap and the time tokens.
        """
        theta = rope_frequencies(self.channels)
        fast = (theta > 0.03).float()  # at least a quarter turn within 52 frames
        radius = (ALIGNMENT * math.sqrt(self.channels) / fast.sum()).sqrt() * fast
        num_aligned = max(1, self.num_heads // 2)
        phase = 2 * math.pi * torch.rand(num_aligned, theta.numel())
        bias = torch.zeros(self.num_heads, self.channels)
        bias[:num_aligned] = torch.cat([radius * phase.cos(), radius * phase.sin()], dim=-1)
        self.query.bias.copy_(bias.flatten())
        self.key_value.bias[: bias.numel()] = bias.flatten()

    def project(self, x: Tensor, memory: Tensor, x_frames: Tensor, memory_frames: Tensor):
        """Turned queries (b, h, l, c), turned keys and plain values (b, h, k, c)."""
        Q = rearrange(self.query(x), "b l (h c) -> b h l c", h=self.num_heads)
        K, V = rearrange(
            self.key_value(memory), "b k (two h c) -> two b h k c", two=2, h=self.num_heads
        )
        Q = rotate(Q, rope_angles(x_frames, self.channels))
        K = rotate(K, rope_angles(memory_frames, self.channels))
        return Q, K, V

    def weights(self, x: Tensor, memory: Tensor, x_frames: Tensor, memory_frames: Tensor):
        """The attention weights (b, h, l, k), to look at; `forward` need not build them."""
        Q, K, _ = self.project(x, memory, x_frames, memory_frames)
        return (Q @ K.mT / math.sqrt(self.channels)).softmax(-1)

    def forward(self, x: Tensor, memory: Tensor, x_frames: Tensor, memory_frames: Tensor) -> Tensor:
        """Let every token of x gather what it needs from memory."""
        Q, K, V = self.project(x, memory, x_frames, memory_frames)
        return self.out(rearrange(_attend(Q, K, V), "b h l c -> b l (h c)"))


def _attend(Q: Tensor, K: Tensor, V: Tensor) -> Tensor:
    """Softmax attention, the fastest way there is.

    That is torch's fused kernel, but for its backward pass in bfloat16 on a CPU: written out, the
    same takes half the time (measured with torch 2.13 and AMX).
    """
    if not (Q.dtype == torch.bfloat16 and Q.device.type == "cpu" and torch.is_grad_enabled()):
        return F.scaled_dot_product_attention(Q, K, V)
    logits = (Q / math.sqrt(Q.shape[-1])) @ K.mT
    return logits.softmax(-1) @ V
