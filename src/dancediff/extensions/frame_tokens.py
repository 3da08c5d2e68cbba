r"""Frame tokens: the decoder's layers see three frames as one token; each frame's details pass by.

Dance changes little in a tenth of a second, so layers at 10 tokens a second lose little and cost a
third. What frames differ in is added afterwards, by a small network that sees one frame at a time.

Symbols (axes: b batch · n dancers, where there is a group · f frames · k = f / 3 tokens
         d channels)
    h      embedded motion, a row a frame   (b, n, f, d)
    low    tokens of three frames           (b, n, k, d)
"""

from typing import Any

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.conditioning import MusicConditioning

FRAMES = 3  # of a token


class FrameTokens(nn.Module):
    r"""Three frames to a token, and back to frames after the layers.

    $$\text{low}_k = W\,[h_{3k},\, h_{3k+1},\, h_{3k+2}], \qquad
      h'_{3k+i} = U_i\,\text{low}'_k + \text{MLP}\big(U_i\,\text{low}'_k,\; h_{3k+i}\big)$$

    Source: ours; patches of frames, as the released FineDance and vision transformers have them.
    Raises: ValueError when the frames are not whole tokens.

    >>> tokens, h = FrameTokens(16), torch.randn(2, 4, 30, 16)
    >>> low = tokens.pool(h)
    >>> low.shape, tokens.unpool(low, h).shape
    (torch.Size([2, 4, 10, 16]), torch.Size([2, 4, 30, 16]))
    """

    def __init__(self, d_model: int):
        super().__init__()
        self.into = nn.Linear(FRAMES * d_model, d_model)
        self.back = nn.Linear(d_model, FRAMES * d_model)
        self.details = nn.Sequential(
            nn.Linear(2 * d_model, 2 * d_model), nn.GELU(), nn.Linear(2 * d_model, d_model)
        )

    def pool(self, h: Tensor) -> Tensor:
        """Tokens of the layers."""
        if h.shape[-2] % FRAMES:
            raise ValueError(
                f"x_t has {h.shape[-2]} frames; frame_tokens needs a multiple of {FRAMES}"
            )
        return self.into(rearrange(h, "... (k i) d -> ... k (i d)", i=FRAMES)).float()

    def unpool(self, low: Tensor, h: Tensor) -> Tensor:
        """Features of frames, from the layers' tokens and what the frames were before."""
        up = rearrange(self.back(low), "... k (i d) -> ... (k i) d", i=FRAMES).float()
        return up + self.details(torch.cat([up, h], dim=-1)).float()


def pool_music(decoder: MusicConditioning, c: Any) -> None:
    """Give a decoder music tokens of as many frames, so that both count positions in tokens."""
    sizes = {"num_heads": c.num_heads, "ff_dim": c.ff_dim, "dropout": c.dropout, "pool": FRAMES}
    front = MusicConditioning(c.d_model, music_dim=c.music_dim, music_frames=c.num_frames, **sizes)
    decoder.music, decoder.null_music = front.music, front.null_music
    if hasattr(decoder, "token_frames"):
        decoder.token_frames = torch.arange(c.num_frames // FRAMES)
