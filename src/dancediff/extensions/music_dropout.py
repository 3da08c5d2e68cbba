r"""Music dropout: training windows without the timbre or without the harmony of their song.

Read first: docs/timbre_and_harmony_mislead.md.

A network that always has timbre and harmony may know songs by them, and be lost in one that sounds
otherwise. One that often lacks them must dance by onsets and beats, and may use them where they
help.

Symbols (axes: b batch · f frames · m music features)
    M   music features, standardised: 0 is the mean of all songs   (b, f, m)
"""

import torch
from torch import Tensor

from dancediff.diffusion.schedule import send
from dancediff.music.features import BLOCKS

DROPPED = ("mfcc", "chroma")  # blocks of features, each dropped for itself


def with_dropped_blocks(M: Tensor, share: float, generator: torch.Generator) -> Tensor:
    """Set each of the blocks `DROPPED` to 0 in a share of the windows.

    Shapes: M (b, f, 35) -> the same.

    >>> g = torch.Generator().manual_seed(0)
    >>> M = with_dropped_blocks(torch.ones(1000, 2, 35), 0.3, g)
    >>> kept = M[:, 0].mean(0)                     # onset 1 | MFCC 20 | chroma 12 | peaks | beats
    >>> bool(kept[0] == 1), abs(kept[1].item() - 0.7) < 0.05, bool((kept[33:] == 1).all())
    (True, True, True)
    """
    M = M.clone()
    for name in DROPPED:
        kept = torch.rand(len(M), generator=generator) >= share
        M[..., BLOCKS[name]] *= send(kept, M.device)[:, None, None]
    return M
