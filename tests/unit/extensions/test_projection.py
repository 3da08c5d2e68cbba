"""Projections: in metres, once guesses are more signal than noise, and never of what is fixed."""

import torch

from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.projection import Projection
from dancediff.motion.representation import TCDIFFPP, Normalizer

SHAPE = (2, 9, 151)


def higher(x, fixed):
    """A metre up, but for frames whose height is fixed."""
    y = x.clone()
    free = 1.0 if fixed.height is None else (~fixed.height).to(x)
    y[..., TCDIFFPP.height] += free
    return y


def test_what_a_segment_is_given_stays():
    hook = Projection(Normalizer(-2 * torch.ones(151), 2 * torch.ones(151)), [higher])
    mask = torch.zeros(SHAPE, dtype=torch.bool)
    mask[0, :4, TCDIFFPP.height] = True
    segment = Segment(0, 0, SHAPE, order=torch.arange(2), mask=mask)
    y = hook.for_segment(segment).apply(torch.zeros(1, *SHAPE), abar=0.9)[0, ..., TCDIFFPP.height]
    assert y.tolist() == [[0.0] * 4 + [0.5] * 5, [0.5] * 9]  # two metres are one unit
    assert hook.apply(torch.zeros(1, *SHAPE), abar=0.9)[0, ..., TCDIFFPP.height].min() == 0.5
