"""Units of motion in which noise is small where it must be."""

import torch

from dancediff.extensions.metre_unit import MIN_SPAN, metre_unit_normalizer
from dancediff.motion.representation import TCDIFFPP


def test_a_channel_that_hardly_moves_does_not_weigh_as_much_as_a_knee():
    x = torch.rand(9, 151, generator=torch.Generator().manual_seed(0))
    still = TCDIFFPP.rot6d.start
    x[:, still] = torch.linspace(0.996, 1.0, 9)
    span = metre_unit_normalizer(x, TCDIFFPP)
    assert torch.allclose((span.high - span.low)[still], torch.tensor(MIN_SPAN))
    assert (span.high - span.low)[still + 1] > 2 * MIN_SPAN
