import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.ddim import ddim_times
from dancediff.diffusion.guidance import guided, off_at_the_end, ramp_up

M = torch.randn(2, 6, 35, generator=torch.Generator().manual_seed(0))
S = torch.tensor([[0, 1, 2], [2, 1, 0]])
X = torch.randn(2, 3, 6, 4, generator=torch.Generator().manual_seed(1))


class Fake:
    """A denoiser whose output depends on every input, and which counts its calls."""

    def __init__(self):
        self.calls = []

    def __call__(self, x_t, t, conditions):
        keep, S = conditions.music_mask, conditions.swap
        self.calls.append((len(x_t), t.tolist(), keep.tolist(), conditions))
        assert t.dtype == torch.long and keep.dtype == torch.bool
        music = conditions.music.sum((1, 2)) * keep
        return x_t * 0.3 + (music + t / 1000)[:, None, None, None] + S[:, :, None, None]


def one(keep, t=7):
    keep = torch.full((2,), keep)
    return Fake()(X, torch.full((2,), t), Conditions(M, S, music_mask=keep))


@pytest.mark.parametrize("w", [0.0, 0.5, 1.0, 2.0, 7.5])
def test_formula(w):
    out = guided(Fake(), Conditions(M, S), w)(X, 7)
    torch.testing.assert_close(out, one(False) + w * (one(True) - one(False)))


def test_one_batched_pass():
    fake = Fake()
    guided(fake, Conditions(M, S), 2.0)(X, 7)
    ((rows, t, keep, conditions),) = fake.calls
    assert rows == 4 and t == [7] * 4 and keep == [True, True, False, False]
    assert torch.equal(conditions.swap, torch.cat([S, S]))
    assert torch.equal(conditions.music, torch.cat([M, M]))


@pytest.mark.parametrize(("w", "with_music"), [(1, True), (1.0, True), (0, False)])
def test_weights_one_and_zero_need_no_second_pass(w, with_music):
    fake = Fake()
    out = guided(fake, Conditions(M, S), w)(X, 7)
    assert torch.equal(
        out, one(with_music)
    )  # acceptance check 16: bit for bit the plain prediction
    assert [c[0] for c in fake.calls] == [2] and fake.calls[0][2] == [with_music] * 2


def test_weight_may_depend_on_the_step():
    denoise = guided(Fake(), Conditions(M, S), lambda t: 3.0 if t > 100 else 1.0)
    torch.testing.assert_close(
        denoise(X, 200), one(False, 200) + 3 * (one(True, 200) - one(False, 200))
    )
    assert torch.equal(denoise(X, 100), one(True, 100))


def test_off_at_the_end_is_edges_ddpm_rule():
    w = off_at_the_end(2.0)
    assert [w(t) for t in (999, 100, 99, 0)] == [2.0, 2.0, 1.0, 1.0]
    assert off_at_the_end(0.5)(0) == 0.5


def test_ramp_up_is_edges_long_ddim_rule():
    times = ddim_times(50)
    w = ramp_up(2.0, times)
    expected = torch.linspace(0, 4, 50).clamp(max=2).tolist()
    assert [w(t) for t in times[:-1]] == pytest.approx(expected, abs=1e-6)


def test_negative_weight():
    for w in (-1, float("nan")):
        with pytest.raises(ValueError, match=f"guidance={w}"):
            guided(Fake(), Conditions(M, S), w)(X, 7)
