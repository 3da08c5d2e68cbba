r"""Frame tokens: the decoder's layers see three frames as one token; each frame's details pass by.

Dance changes little in a tenth of a second, so layers at 10 tokens a second lose little and cost a
third. What frames differ in is added afterwards, by a small network that sees one frame at a time.

Symbols (axes: b batch · n dancers, where there is a group · f frames · k = f / 3 tokens
         i frame of a token · d channels)
    h      embedded motion, a row a frame   (b, n, f, d)
    low    tokens of three frames           (b, n, k, d)
"""

from typing import Any

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.conditioning import MusicConditioning, MusicEncoder

FRAMES = 3  # of a token


class FrameTokens(nn.Module):
    r"""Three frames to a token, and back to frames after the layers.

    $$\text{low}_k = W\,[h_{3k},\, h_{3k+1},\, h_{3k+2}], \qquad
      h'_{3k+i} = U_i\,\text{low}'_k + \text{MLP}\big(U_i\,\text{low}'_k,\; h_{3k+i}\big)$$

    Source: ours; patches of frames, as the released FineDance and vision transformers have them.
    Frames that are too few for a last token are filled up with the last of them.

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
        return self.into(rearrange(whole(h), "... (k i) d -> ... k (i d)", i=FRAMES)).float()

    def unpool(self, low: Tensor, h: Tensor) -> Tensor:
        """Features of frames, from the layers' tokens and what the frames were before."""
        up = rearrange(self.back(low), "... k (i d) -> ... (k i) d", i=FRAMES).float()
        up = up[..., : h.shape[-2], :]
        return up + self.details(torch.cat([up, h], dim=-1)).float()


def whole(x: Tensor) -> Tensor:
    """Frames for whole tokens: the last one comes again until they are; (..., f, d).

    >>> whole(torch.arange(4.0)[:, None]).flatten().tolist()
    [0.0, 1.0, 2.0, 3.0, 3.0, 3.0]
    """
    missing = -x.shape[-2] % FRAMES
    return torch.cat([x, x[..., -1:, :].expand(*x.shape[:-2], missing, -1)], -2) if missing else x


class MusicTokens(MusicEncoder):
    """A `MusicEncoder` whose tokens are those of as many frames, however many there are."""

    def _encode(self, M: Tensor) -> Tensor:
        return super()._encode(whole(M))


def pool_music(decoder: MusicConditioning, c: Any) -> None:
    """Give a decoder such music tokens, so that both count positions in tokens."""
    blocks = {"num_heads": c.num_heads, "ff_dim": c.ff_dim, "dropout": c.dropout}
    decoder.music = MusicTokens(c.music_dim, c.d_model, pool=FRAMES, **blocks)
    k = -(-c.num_frames // FRAMES)
    decoder.null_music = nn.Parameter(torch.randn(1, k, c.d_model))
    if hasattr(decoder, "music_token_frames"):
        decoder.music_token_frames = torch.arange(k)
