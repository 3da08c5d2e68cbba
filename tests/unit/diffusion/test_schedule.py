import math

import pytest
import torch

from dancediff.diffusion.schedule import abar_at, cosine_abar, gaussian, q_sample


@pytest.mark.parametrize(
    ("t", "value"), [(99, 0.972), (499, 0.494), (979, 9.71e-4), (998, 2.43e-6), (999, 2.43e-9)]
)
def test_known_values_of_the_schedule(t, value):
    assert float(cosine_abar(1000)[t]) == pytest.approx(value, rel=5e-3)


@pytest.mark.parametrize("num_steps", [1, 10, 1000])
def test_schedule_falls_from_one_towards_zero(num_steps):
    abar = cosine_abar(num_steps)
    assert abar.shape == (num_steps,) and abar.dtype == torch.float64
    assert bool((abar > 0).all()) and bool((abar < 1).all()) and bool((abar.diff() < 0).all())
    beta = 1 - abar[1:] / abar[:-1]
    assert float(beta.max() if num_steps > 1 else 0) <= 0.999 + 1e-12


def test_abar_at_minus_one_is_clean():
    abar = cosine_abar(10)
    assert abar_at(abar, -1) == 1.0
    assert abar_at(abar, 9) == float(abar[9])
    for t in (-2, 10):
        with pytest.raises(ValueError, match=f"t={t} "):
            abar_at(abar, t)


def test_q_sample_int_and_batched_steps_agree():
    abar = cosine_abar()
    x_0, eps = torch.randn(2, 3, 1, 4, 5).unbind(0)
    t = torch.tensor([0, 500, 999])
    batched = q_sample(x_0, t, abar, eps)
    for i, step in enumerate(t.tolist()):
        one = q_sample(x_0[i : i + 1], step, abar, eps[i : i + 1])
        torch.testing.assert_close(batched[i : i + 1], one)
        a = float(abar[step])
        torch.testing.assert_close(one[0], math.sqrt(a) * x_0[i] + math.sqrt(1 - a) * eps[i])
    assert torch.equal(q_sample(x_0, -1, abar, eps), x_0)


def test_q_sample_keeps_unit_variance():
    x_0, eps = torch.randn(2, 1, 1, 400, 100, generator=torch.Generator().manual_seed(0)).unbind(0)
    for t in (0, 300, 700, 999):
        assert float(q_sample(x_0, t, cosine_abar(), eps).var()) == pytest.approx(1, abs=0.03)


def test_q_sample_takes_roots_in_the_precision_of_the_schedule_and_survives_float32():
    abar, t = cosine_abar(), torch.arange(20)
    noise = q_sample(torch.zeros(20, 1, 1, 1), t, abar, torch.ones(20, 1, 1, 1)).flatten()
    torch.testing.assert_close(noise, (1 - abar[:20]).sqrt().float(), rtol=1e-6, atol=0)
    x_0, eps = torch.randn(2, 1, 1, 4, 5).unbind(0)
    torch.testing.assert_close(
        q_sample(x_0, torch.tensor([0]), abar.float(), eps),
        q_sample(x_0, torch.tensor([0]), abar, eps),
        atol=1e-4,
        rtol=0,
    )


def test_gaussian_is_seeded_and_drawn_in_float32():
    draw = lambda seed, **kw: gaussian((3, 4), generator=torch.Generator().manual_seed(seed), **kw)  # noqa: E731
    assert torch.equal(draw(1), draw(1))
    assert not torch.equal(draw(1), draw(2))
    assert torch.equal(draw(1, dtype=torch.float64), draw(1).double())


def test_errors():
    with pytest.raises(ValueError, match="num_steps=0"):
        cosine_abar(0)
    with pytest.raises(ValueError, match=r"generator is a int; use torch.Generator\(\)"):
        gaussian((2, 3), generator=7)
    with pytest.raises(ValueError, match="eps"):
        q_sample(torch.zeros(1, 1, 2, 3), 5, cosine_abar(), torch.zeros(1, 1, 2, 1))
    for t in (-1, 1000):  # -1 would be the last level, counted from the end
        with pytest.raises(ValueError, match=rf"t=\[{t}\] must lie in 0 ... 999; clean is t=-1"):
            q_sample(
                torch.zeros(1, 1, 2, 3), torch.tensor([t]), cosine_abar(), torch.zeros(1, 1, 2, 3)
            )
