"""Own overlap with networks that are plain functions."""

import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.own_overlap import draw_overlap, overlap_weights, with_own_overlap


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


def mixed_of(model, x_0, conditions, share, g):
    return with_own_overlap(model, x_0, conditions, draw_overlap(x_0, share, 1000, g))


def test_the_first_half_is_the_guess_and_passes_into_the_truth():
    x_0, conditions, g = setting(2)
    mixed = mixed_of(Constant(), x_0, conditions, 1.0, g)
    assert torch.allclose(mixed, (7 * overlap_weights(40))[:, None].expand_as(mixed))
    assert (mixed[:, :, :5] == 7).all() and (mixed[:, :, 20:] == 0).all()
    assert (mixed.diff(dim=2) <= 0).all()


def test_a_share_of_windows_is_chosen_and_keeps_its_music():
    x_0, conditions, g = setting(400)
    model = Constant()
    mixed = mixed_of(model, x_0, conditions, 0.25, g)
    chosen = (mixed != 0).flatten(1).any(1).nonzero().flatten().tolist()
    assert len(chosen) == 100 and chosen != list(range(100))
    assert sorted(model.asked[2].music[:, 0, 0].tolist()) == chosen
    t = model.asked[1]
    assert 200 <= t.min() < 250 and 650 < t.max() < 700


def test_no_share_asks_nothing():
    x_0, _, g = setting(3)
    assert draw_overlap(x_0, 0.0, 1000, g) is None
    assert draw_overlap(x_0, 0.1, 1000, g) is None  # less than half a window


def test_the_guess_brings_no_gradient():
    x_0, conditions, g = setting(2)
    weight = torch.ones((), requires_grad=True)

    class Learned(Constant):
        def denoise(self, x_t, t, conditions):
            return x_t * weight

    assert not mixed_of(Learned(), x_0, conditions, 1.0, g).requires_grad
