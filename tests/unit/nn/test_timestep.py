import math

import pytest
import torch

from dancediff.nn.conditioning import TimestepEncoder, sinusoid


def test_frequencies_run_from_1_to_1_over_10000():
    row = sinusoid(torch.tensor([7]), 256)[0]
    assert math.isclose(row[0], math.sin(7), abs_tol=1e-6)
    assert math.isclose(row[40], math.sin(7 / 10_000 ** (40 / 127)), abs_tol=1e-5)  # geometric
    assert math.isclose(row[127], math.sin(7 / 10_000), abs_tol=1e-6)
    assert math.isclose(row[255], math.cos(7 / 10_000), abs_tol=1e-6)


def test_every_step_is_told_apart():
    rows = sinusoid(torch.arange(1000), 64)
    assert torch.pdist(rows).min() > 1e-2


def test_encoder_depends_on_the_step():
    vector, tokens = TimestepEncoder(16)(torch.tensor([3, 3, 700]))
    assert torch.equal(tokens[0], tokens[1])
    assert (vector[0] - vector[2]).abs().max() > 0.01
    assert not torch.equal(tokens[0, 0], tokens[0, 1])


def test_odd_channels_are_refused_and_two_are_enough():
    with pytest.raises(ValueError, match="channels=3 must be even"):
        sinusoid(torch.tensor([0]), 3)
    assert sinusoid(torch.tensor([7]), 2)[0].tolist() == pytest.approx([math.sin(7), math.cos(7)])
