"""Music dropout hides whole blocks of whole windows, each block for itself."""

import pytest
import torch

from dancediff.extensions.music_dropout import with_dropped_blocks
from dancediff.music.features import BEATS, CHROMA, MFCC, ONSET, PEAKS


def test_blocks_are_dropped_whole_and_each_for_itself():
    M = torch.rand(2000, 3, 35) + 1
    dropped = with_dropped_blocks(M, 0.3, torch.Generator().manual_seed(0))
    for block in (ONSET, PEAKS, BEATS):
        assert torch.equal(dropped[..., block], M[..., block])
    gone = [(dropped[..., block] == 0).flatten(1) for block in (MFCC, CHROMA)]
    timbre, harmony = (all_of_it.all(1) for all_of_it in gone)
    for some, every in zip(gone, (timbre, harmony), strict=True):
        assert torch.equal(some.any(1), every)  # never a part of it
        assert every.float().mean().item() == pytest.approx(0.3, abs=0.04)
    assert (timbre & harmony).float().mean().item() == pytest.approx(0.09, abs=0.03)
    assert (M > 0).all()  # the batch itself stays


def test_the_same_generator_drops_the_same():
    M = torch.ones(50, 3, 35)
    one, other = (with_dropped_blocks(M, 0.5, torch.Generator().manual_seed(4)) for _ in range(2))
    assert torch.equal(one, other)
