"""Own overlap with networks that are plain functions."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.own_overlap import overlap_weights, with_own_overlap


class Constant:
    """Guesses the same number everywhere, and keeps what it was asked."""

    abar = torch.linspace(0.999, 0.001, 1000)

    def denoise(self, x_t, t, conditions):
        self.asked = x_t, t, conditions
        return torch.full_like(x_t, 7.0)


def setting(b: int):
    x_0 = torch.zeros(b, 2, 40, 5)
    conditions = Conditions(torch.arange(b).float()[:, None, None].expand(b, 40, 35))
    return x_0, conditions, torch.Generator().manual_seed(3)


def test_the_first_half_is_the_guess_and_passes_into_the_truth():
    x_0, conditions, g = setting(2)
    mixed = with_own_overlap(Constant(), x_0, conditions, 1.0, g)
    assert torch.allclose(mixed, (7 * overlap_weights(40))[:, None].expand_as(mixed))
    assert (mixed[:, :, :5] == 7).all() and (mixed[:, :, 20:] == 0).all()
    assert (mixed.diff(dim=2) <= 0).all()


def test_a_share_of_windows_is_chosen_and_keeps_its_music():
    x_0, conditions, g = setting(400)
    model = Constant()
    mixed = with_own_overlap(model, x_0, conditions, 0.25, g)
    chosen = (mixed != 0).flatten(1).any(1)
    assert chosen.float().mean().item() == pytest.approx(0.25, abs=0.06)
    assert model.asked[2].music[:, 0, 0].tolist() == chosen.nonzero().flatten().tolist()
    t = model.asked[1]
    assert 200 <= t.min() < 250 and 650 < t.max() < 700


def test_no_share_asks_nothing():
    x_0, conditions, g = setting(3)
    assert with_own_overlap(None, x_0, conditions, 0.0, g) is x_0


def test_the_guess_brings_no_gradient():
    x_0, conditions, g = setting(2)
    weight = torch.ones((), requires_grad=True)

    class Learned(Constant):
        def denoise(self, x_t, t, conditions):
            return x_t * weight

    assert not with_own_overlap(Learned(), x_0, conditions, 1.0, g).requires_grad
