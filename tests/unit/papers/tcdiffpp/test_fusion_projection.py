import pytest
import torch

from dancediff.extensions.residuals import FusionResidual
from dancediff.nn.decoder import FusionProjection


def test_is_three_linear_layers_on_the_row_of_dancers():
    fp, h = FusionProjection(3, 4, 8), torch.randn(2, 3, 5, 4)
    row = h.transpose(1, 2).flatten(2)  # (b, f, (n d))
    y = fp.back(fp.middle(fp.into(row).relu()).relu())
    torch.testing.assert_close(fp(h), y.unflatten(2, (3, 4)).transpose(1, 2))


def test_smaller_groups_are_zero_padded():
    fp, h = FusionProjection(5, 4, 8), torch.randn(2, 3, 5, 4)
    torch.nn.init.normal_(fp.back.bias)  # zeros at first; each place has its own
    padded = torch.cat([h, torch.zeros(2, 2, 5, 4)], dim=1)
    torch.testing.assert_close(fp(h), fp(padded)[:, :3])


def test_mixes_dancers_but_not_frames():
    fp, h = FusionProjection(3, 4, 64), torch.randn(1, 3, 5, 4, requires_grad=True)
    fp(h)[0, 0, 2].sum().backward()
    touched = h.grad[0].abs().amax(-1) > 0
    assert touched[:, 2].all() and touched.sum() == 3


def test_signal_keeps_its_size():
    torch.manual_seed(0)
    y = FusionProjection(5, 64, 256)(torch.randn(4, 5, 30, 64))
    assert 0.7 < y.std() < 2


def test_too_many_dancers():
    with pytest.raises(ValueError, match="4 dancers; at most 3"):
        FusionProjection(3, 4, 8)(torch.zeros(1, 4, 5, 4))


def test_with_a_residual_the_mixed_dancers_are_added():
    fp, h = FusionProjection(3, 4, 8), torch.randn(2, 3, 5, 4)
    torch.testing.assert_close(FusionResidual(fp)(h), h + fp(h))


def test_the_residual_begins_near_zero_and_all_its_layers_learn():
    torch.manual_seed(0)
    residual = FusionResidual(FusionProjection(max_dancers=3, d_model=16, hidden=64))
    h = torch.randn(2, 3, 5, 16)
    out = residual(h)
    assert (out - h).std() < 0.05 * h.std()
    (out - torch.randn(out.shape)).square().sum().backward()
    assert all(weights.grad.abs().max() > 0 for weights in residual.parameters())
