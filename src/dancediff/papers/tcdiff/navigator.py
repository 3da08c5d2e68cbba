r"""Dance-Trajectory Navigator (DTN): where everybody goes, from the music and where they went.

Read first: Dai et al. 2025 (TCDiff) section 3.2 · `dancediff.nn.encoder_layer`.

Symbols (axes: b batch · n dancers · h frames of history · m music features · d channels
         c the two coordinates on the floor)
    path     places on the floor, normalised x and z                   (b, n, h, 2)
    music    of the history, and of the frames that are guessed        (b, h, m)
    s        frames that a step of the roll-out adds, `stride`
"""

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.conditioning import sinusoid
from dancediff.nn.encoder_layer import EncoderLayer


class Navigator(nn.Module):
    r"""Given frames [0, h) of all paths it guesses frames [s, h + s).

    $$\hat p_{f+s} = p_f + \text{MLP}([\,\text{encoder}([\text{LSTM}(p), M'])_f,\ M'_{f+s}]),
      \qquad M' = \text{MLP}(M)$$

    Source: TCDiff section 3.2; sizes as in the released code.  Differs: every token sees itself and
    those before it, of all dancers, so that no guess has its target in its input; in the released
    code 75 of 100 have, because its causal mask is never applied. Its LSTM also runs over the clips
    of a batch instead of over time. What is guessed is how far a dancer goes in s frames.

    Shapes: path (b, n, h, 2), music (b, h, m), later (b, h, m) -> (b, n, h, 2).

    >>> navigator = Navigator(35, width=16, music_hidden=32, num_layers=1, num_heads=2)
    >>> path, music = torch.zeros(2, 3, 20, 2), torch.randn(2, 20, 35)
    >>> navigator(path, music, music).shape
    torch.Size([2, 3, 20, 2])
    """

    def __init__(
        self,
        music_dim: int,
        *,
        width: int,
        music_hidden: int,
        num_layers: int,
        num_heads: int,
        dropout: float = 0.0,
    ):
        """``width``: of the paths' and the music's half of a token."""
        super().__init__()
        d = 2 * width
        self.lstm = nn.LSTM(2, width, num_layers=3, batch_first=True)
        self.music = nn.Sequential(
            nn.Linear(music_dim, music_hidden),
            nn.LeakyReLU(),
            nn.Linear(music_hidden, music_hidden),
            nn.LeakyReLU(),
            nn.Linear(music_hidden, width),
        )
        self.layers = nn.ModuleList(
            EncoderLayer(d, num_heads=num_heads, ff_dim=4 * d, dropout=dropout)
            for _ in range(num_layers)
        )
        self.out = nn.Sequential(
            nn.Linear(d + width, d),
            nn.LeakyReLU(),
            nn.Linear(d, d),
            nn.LeakyReLU(),
            nn.Linear(d, width),
            nn.LeakyReLU(),
            nn.Linear(width, 2),
        )

    def forward(self, path: Tensor, music: Tensor, later: Tensor) -> Tensor:
        """See the equation; ``later``: the music of the guessed frames."""
        b, n, h, _ = path.shape
        frames = torch.arange(h, device=path.device)
        motion, _ = self.lstm(rearrange(path, "b n h c -> (b n) h c"))
        motion = rearrange(motion, "(b n) h d -> b h n d", b=b)
        music_now, music_later = (
            self.music(part)[:, :, None].expand(b, h, n, -1) for part in (music, later)
        )
        tokens = torch.cat([motion, music_now], dim=-1)
        tokens = tokens + sinusoid(frames, tokens.shape[-1])[:, None]
        tokens = rearrange(tokens, "b h n d -> b (h n) d").float()
        mask = frames[:, None] >= frames
        mask = mask.repeat_interleave(n, 0).repeat_interleave(n, 1)
        for layer in self.layers:
            tokens = layer(tokens, mask)
        tokens = rearrange(tokens, "b (h n) d -> b h n d", n=n)
        with torch.autocast(path.device.type, enabled=False):  # centimetres need float32
            way = self.out(torch.cat([tokens, music_later], dim=-1).float())
        return path + rearrange(way, "b h n c -> b n h c")


def roll_out(
    navigator: Navigator, start: Tensor, music: Tensor, *, history: int, stride: int
) -> Tensor:
    """Paths to a whole song, ``stride`` frames at a time, from dancers who stand still before it.

    Source: TCDiff section 3.2.  Differs: the paper does not say how a song begins; here everybody
    has stood for ``history`` frames, without music (zeros: the mean of all).

    Shapes: start (b, n, 2), music (b, F, m), standardised -> (b, n, F, 2).
    """
    b, frames, m = music.shape
    silence = music.new_zeros(b, history, m)
    music = torch.cat([silence, music, silence[:, :stride]], dim=1)
    path = start[:, :, None].expand(-1, -1, history, -1)
    for at in range(0, frames, stride):
        known = path[:, :, at : at + history]
        now, later = (music[:, k : k + history] for k in (at, at + stride))
        path = torch.cat([path, navigator(known, now, later)[:, :, -stride:]], dim=2)
    return path[:, :, history : history + frames]
