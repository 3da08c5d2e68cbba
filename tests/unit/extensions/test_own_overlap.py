"""Own overlap with networks that are plain functions."""

import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import q_sample
from dancediff.extensions.own_overlap import draw_overlap, overlap_weights, with_own_overlap


class Constant:
    """Guesses the same number everywhere, and keeps what it was asked."""

    abar = torch.linspace(0.999, 0.001, 1000)

    def denoise(self, x_t, t, conditions):
        self.asked = x_t, t, conditions
        return torch.full_like(x_t, 7.0)


def setting(b: int):
    x_0 = torch.randn(b, 2, 40, 5, generator=torch.Generator().manual_seed(b))
    conditions = Conditions(torch.arange(b).float()[:, None, None].expand(b, 40, 35))
    return x_0, conditions, torch.Generator().manual_seed(3)


def test_the_first_half_is_the_guess_and_passes_into_the_truth():
    x_0, conditions, g = setting(2)
    mixed = with_own_overlap(Constant(), x_0, conditions, draw_overlap(x_0, 1.0, 1000, g))
    w = overlap_weights(40)[:, None]
    torch.testing.assert_close(mixed, (1 - w) * x_0 + 7 * w)
    assert (mixed[:, :, :5] == 7).all() and torch.equal(mixed[:, :, 20:], x_0[:, :, 20:])
    assert (w.diff(dim=0) <= 0).all()


def test_a_share_of_windows_is_chosen_and_keeps_its_music():
    x_0, conditions, g = setting(400)
    model, drawn = Constant(), draw_overlap(x_0, 0.25, 1000, g)
    mixed = with_own_overlap(model, x_0, conditions, drawn)
    chosen = (mixed != x_0).flatten(1).any(1).nonzero().flatten().tolist()
    assert len(chosen) == 100 and chosen != list(range(100))
    assert sorted(drawn.rows.tolist()) == chosen
    x_t, t, asked = model.asked
    torch.testing.assert_close(x_t, q_sample(x_0[drawn.rows], drawn.s, model.abar, drawn.eps))
    assert torch.equal(t, drawn.s) and asked.music[:, 0, 0].tolist() == drawn.rows.tolist()
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

    drawn = draw_overlap(x_0, 1.0, 1000, g)
    assert not with_own_overlap(Learned(), x_0, conditions, drawn).requires_grad
