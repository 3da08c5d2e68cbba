"""Group-global attention: every frame of every dancer attends to all others of the group.

Symbols (axes: b batch · n dancers · f frames · d channels)
    h   tokens of the group                  (b, n, f, d)
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.attention import Attention, FeedForward
from dancediff.nn.decoder import token_frames


class GroupGlobalAttention(nn.Module):
    r"""Self-attention over all tokens of a group and one that tells how many dancers it has.

    $$h \leftarrow h + \text{SA}(\text{LN}(h), [\text{LN}(h), e_n]), \qquad
      h \leftarrow h + \text{FF}(\text{LN}(h))$$

    Dancers have no identity: dancers exchanged in the input are exchanged in the output.

    Source: GCD section 3.3.

    Shapes: h (b, n, f, d) -> the same.

    >>> attend = GroupGlobalAttention(16, max_dancers=5, num_heads=2, ff_dim=32)
    >>> h = torch.randn(2, 3, 7, 16)
    >>> torch.allclose(attend(h).flip(1), attend(h.flip(1)), atol=1e-5)
    True
    """

    def __init__(
        self, d_model: int, max_dancers: int, *, num_heads: int, ff_dim: int, dropout: float = 0.0
    ):
        super().__init__()
        self.attention = Attention(d_model, num_heads)
        self.feed_forward = FeedForward(d_model, ff_dim, dropout)
        self.norms = nn.ModuleList(nn.LayerNorm(d_model) for _ in range(2))
        self.count = nn.Parameter(torch.randn(max_dancers, d_model))
        self.dropout = nn.Dropout(dropout)

    def forward(self, h: Tensor) -> Tensor:
        """See the equation; the token of the number stands at frame 0."""
        b, n = h.shape[:2]
        frames, tokens = token_frames(h), rearrange(h, "b n f d -> b (f n) d")
        x = self.norms[0](tokens)
        memory = torch.cat([x, self.count[n - 1].to(x).expand(b, 1, -1)], dim=1)
        memory_frames = torch.cat([frames, frames.new_zeros(1)])
        tokens = tokens + self.dropout(self.attention(x, memory, frames, memory_frames))
        tokens = tokens + self.dropout(self.feed_forward(self.norms[1](tokens)))
        return rearrange(tokens, "b (f n) d -> b n f d", n=n)
