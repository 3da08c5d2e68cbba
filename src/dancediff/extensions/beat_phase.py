r"""Beat phase: how far a frame is on its way from one beat to the next.

Read first: notebook 02.

Symbols (axes: b batch · f frames at 30 fps)
    M      music features                     (b, f, 35), column 34 is 1 where a beat falls
    phi    phase, 0 on a beat, then up to 1   (b, f)
"""

import torch
from torch import Tensor, nn

from dancediff.extensions.parts import Part, Pass
from dancediff.music.features import BEATS

NUM_WAVES = 4
NO_BEAT = 15.0  # frames; the period where a window has less than two beats: 120 a minute
FAR = 2**30


def beat_phase(M: Tensor) -> Tensor:
    r"""Phase between the beats around each frame, in beats.

    $$\varphi_f = \frac{f - \text{last}_f}{\text{next}_f - \text{last}_f}$$

    Before the first and after the last beat of a window the median period goes on.

    Shapes: M (b, f, 35) -> (b, f) in [0, 1).

    >>> M = torch.zeros(1, 9, 35)
    >>> M[:, [2, 6], 34] = 1
    >>> beat_phase(M)[0].tolist()
    [0.5, 0.75, 0.0, 0.25, 0.5, 0.75, 0.0, 0.25, 0.5]
    """
    beat = M[..., BEATS.start] > 0.5
    f = torch.arange(M.shape[1], device=M.device).expand(beat.shape)
    last = f.masked_fill(~beat, -1).cummax(1).values
    here_or_next = f.masked_fill(~beat, FAR).flip(1).cummin(1).values.flip(1)
    after = torch.cat([here_or_next[:, 1:], torch.full_like(f[:, :1], FAR)], 1)
    between = (last >= 0) & (after < FAR)
    period = (after - last).float().masked_fill(~between, torch.nan)
    usual = period.nanmedian(1, keepdim=True).values.nan_to_num(NO_BEAT)
    period = torch.where(between, period, usual)
    since = torch.where(last >= 0, (f - last) / period, -(after - f) / period)
    return since.masked_fill((last < 0) & (after == FAR), 0) % 1


def beat_waves(M: Tensor) -> Tensor:
    r"""Two waves a beat, as a clock for networks; zeros in windows without a beat.

    $$[\sin 2\pi\varphi,\; \cos 2\pi\varphi,\; \sin 4\pi\varphi,\; \cos 4\pi\varphi]$$

    Shapes: M (b, f, 35) -> (b, f, 4).

    >>> M = torch.zeros(1, 9, 35)
    >>> M[:, [0, 4, 8], 34] = 1
    >>> beat_waves(M)[0, :3, 1].round(decimals=3).tolist()      # cos: on the beat, off, between
    [1.0, -0.0, -1.0]
    """
    angle = 2 * torch.pi * beat_phase(M)
    waves = torch.stack([angle.sin(), angle.cos(), (2 * angle).sin(), (2 * angle).cos()], -1)
    return waves * (M[..., BEATS] > 0.5).any(1, keepdim=True)


class BeatPhase(Part):
    r"""Add to every token how far its frame is between two beats.

    $$h_{nf} \leftarrow h_{nf} + W\,\text{waves}(\varphi_f)$$

    A beat is one number in one of 150 music tokens; that a dance rests on beats has to be found out
    from that through attention alone, which takes thousands of steps.
    """

    def __init__(self, d_model: int):
        super().__init__()
        self.embed_waves = nn.Linear(NUM_WAVES, d_model, bias=False)

    def tokens(self, h: Tensor, run: Pass) -> Tensor:
        """The same for all dancers; nothing where the music is masked."""
        conditions = run.conditions
        waves = self.embed_waves(beat_waves(conditions.music)).float()
        waves = waves * conditions.music_mask[:, None, None]
        return h + waves.reshape(len(h), *[1] * (h.ndim - 3), *waves.shape[1:])
