import torch
import torch.nn.functional as F

from dancediff.nn.conditioning import FiLM


def test_scales_and_shifts_each_channel():
    film, h, cond = FiLM(3), torch.randn(2, 4, 5, 3), torch.randn(2, 3)
    scale, shift = film.scale_and_shift[1](F.mish(cond)).chunk(2, dim=-1)
    expected = torch.stack([(1 + scale[i]) * h[i] + shift[i] for i in range(2)])
    torch.testing.assert_close(film(h, cond), expected)


def test_zero_scale_and_shift_change_nothing():
    film, h = FiLM(3), torch.randn(2, 4, 3)
    for parameter in film.parameters():
        torch.nn.init.zeros_(parameter)
    assert torch.equal(film(h, torch.randn(2, 3)), h)
