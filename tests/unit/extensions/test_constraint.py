"""Constraints against a Gaussian process, whose conditional distribution is known."""

import pytest
import torch

from dancediff.diffusion.long_sampling import Segment
from dancediff.diffusion.pinning import Pinning
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.diffusion.schedule import abar_at, cosine_abar, gaussian
from dancediff.extensions.constraint import Constraint, ConstraintHook, covariance
from dancediff.extensions.initial_frames import InitialFrames
from dancediff.extensions.preconditioning import Preconditioning, dct_matrix

ABAR = cosine_abar()
F = 60
STD = 0.8 / (1 + torch.arange(F)[:, None].double() / 3) ** 2  # (k, 1): slow parts are large
C = dct_matrix(F).double()
PRIOR = C.T @ (STD**2 * C)  # covariance over the frames


def gen(seed=0):
    return torch.Generator().manual_seed(seed)


def process(b):
    """b draws (b, 1, F, 1)."""
    z = torch.randn(b, F, generator=gen(), dtype=torch.float64) * STD[:, 0]
    return (z @ C)[:, None, :, None]


def exact():
    """The best denoiser of that process is the linear guess."""
    p = Preconditioning(F, 1).double()
    p.std = STD
    return lambda x_t, t: p.linear_guess(x_t, torch.full((len(x_t),), abar_at(ABAR, t)).to(x_t))


def known_at(frames, value, slack=None):
    mask = torch.zeros(1, F, 1, dtype=torch.bool)
    mask[:, frames] = True
    values = torch.zeros(1, F, 1, dtype=torch.float64)
    values[:, frames] = value
    loose = None if slack is None else torch.where(mask, slack, 0.0)
    return Constraint(mask, values, loose)


def draw(constraint, b=3000, eta=1.0):
    options, g = SamplerOptions(ABAR, "ddim", 60, eta=eta, clamp=None), gen(1)
    x_T = gaussian((b, 1, F, 1), generator=g, dtype=torch.float64)
    hooks = [ConstraintHook(STD, [constraint], as_linear=float)]  # `exact` is the linear guess
    return sample(exact(), x_T.shape, options, generator=g, x_T=x_T, hooks=hooks)[:, 0, :, 0]


def test_samples_follow_the_exact_conditional_distribution():
    frames, value = torch.tensor([10, 40]), torch.tensor([[0.5], [-0.4]], dtype=torch.float64)
    x = draw(known_at(frames, value))
    K = PRIOR[:, frames] @ torch.linalg.inv(PRIOR[frames][:, frames])
    mean = (K @ value)[:, 0]
    std = (PRIOR - K @ PRIOR[frames]).diagonal().clamp_min(0).sqrt()
    torch.testing.assert_close(x[:, frames], value.T.expand(len(x), 2), atol=1e-6, rtol=0)
    torch.testing.assert_close(x.mean(0), mean, atol=0.03, rtol=0)
    torch.testing.assert_close(x.std(0), std, atol=0.04, rtol=0)


def test_the_bent_guess_is_the_conditional_mean():
    x_0, frames = process(5), torch.tensor([3, 4, 30, 59])
    eps = torch.randn(x_0.shape, generator=gen(2), dtype=torch.float64)
    t = 300
    a = abar_at(ABAR, t)
    x_t = a**0.5 * x_0 + (1 - a) ** 0.5 * eps
    y = x_0[0, 0, frames, 0]
    conditioned = known_at(frames, y[:, None]).condition(exact()(x_t[:1], t), a, STD)[0, 0, :, 0]
    # the slow way: all that is known, noisy frames and clean entries, in one equation
    A = torch.cat([a**0.5 * torch.eye(F).double(), torch.eye(F).double()[frames]])
    noise = torch.cat([torch.full((F,), 1 - a), torch.full((4,), 1e-12)]).double()
    measured = torch.cat([x_t[0, 0, :, 0], y])
    mean = PRIOR @ A.T @ torch.linalg.solve(A @ PRIOR @ A.T + noise.diag(), measured)
    torch.testing.assert_close(conditioned, mean, atol=1e-5, rtol=0)


def test_covariance_is_that_of_the_linear_guess():
    x_0 = process(20000)
    eps = torch.randn(x_0.shape, generator=gen(2), dtype=torch.float64)
    for t in (100, 600):
        a = abar_at(ABAR, t)
        missed = (x_0 - exact()(a**0.5 * x_0 + (1 - a) ** 0.5 * eps, t))[:, 0, :, 0]
        cov = covariance(a, STD, F, torch.arange(F))[0]
        torch.testing.assert_close(missed.T.cov(), cov, atol=0.03 * cov.max().item(), rtol=0)


def test_pasting_alone_leaves_a_jump():
    # the seam of two segments: the first 30 frames are known
    known = process(400)[:, :, :30]

    natural = process(4000).diff(dim=2).square().mean((0, 1, 3)).sqrt()

    def seam_over_natural(steps=50, eta=1.0, hooks=()):
        pin, g = Pinning(known, ABAR, generator=gen(1)), gen(2)
        options = SamplerOptions(ABAR, "ddim", steps, eta=eta, clamp=None)
        x_T = gaussian((400, 1, F, 1), generator=g, dtype=torch.float64)
        x = sample(exact(), x_T.shape, options, generator=g, x_T=x_T, pin=pin, hooks=hooks)
        x = torch.cat([known, x[:, :, 30:]], 2)
        speed = x.diff(dim=2).square().mean((0, 1, 3)).sqrt()
        return float(speed[29] / natural[29])

    class Hook:
        def apply(self, x, a):  # every draw has known frames of its own
            rows = [known_at(torch.arange(22, 30), k[0, 22:]) for k in known]
            together = Constraint(
                *(torch.cat([getattr(r, n) for r in rows]) for n in ("mask", "value"))
            )
            return together.condition(x.transpose(0, 1), a, STD).transpose(0, 1)

    assert seam_over_natural() > 2
    assert seam_over_natural(hooks=[Hook()]) < 1.15


def test_a_network_is_corrected_in_fewer_frames_than_the_linear_guess():
    known, guess = known_at(torch.tensor([30]), 1.0), torch.zeros(1, 1, F, 1, dtype=torch.float64)
    for t in (300, 600):
        a = abar_at(ABAR, t)
        narrow = ConstraintHook(STD, [known]).apply(guess, a).flatten()
        wide = ConstraintHook(STD, [known], as_linear=float).apply(guess, a).flatten()
        assert narrow[30] == pytest.approx(1, abs=1e-6) and wide[30] == pytest.approx(1, abs=1e-6)
        assert narrow.abs().sum() < 0.9 * wide.abs().sum(), t
        less_noise = a / (a + (1 - a) * ((1 + 3 * a**2) / 4) ** 2)  # the share, squared
        assert torch.equal(narrow, known.condition(guess, less_noise, STD).flatten())


def test_slack_gives_way():
    x, var = draw(known_at(torch.tensor([30]), 0.5, slack=0.1))[:, 30], float(PRIOR[30, 30])
    share = var / (var + 0.1**2)  # of the way to what was asked for
    assert float(x.mean()) == pytest.approx(0.5 * share, abs=0.01)
    assert float(x.std()) == pytest.approx((share * 0.1**2) ** 0.5, rel=0.1)


def test_many_dancers_and_features_at_once_equal_one_at_a_time():
    draw = gen(3)
    mask = torch.rand(3, F, 4, generator=draw) < 0.2
    mask[:, :, 2] = mask[:1, :, :1].squeeze(2)  # some share their frames
    value, slack = torch.rand(2, 3, F, 4, generator=draw, dtype=torch.float64)
    std = STD * torch.tensor([1.0, 0.3, 0.1, 2.0])
    x = torch.randn(2, 3, F, 4, generator=draw, dtype=torch.float64)
    together = Constraint(mask, value, slack).condition(x, 0.4, std)
    for n in range(3):
        for d in range(4):
            one = (slice(n, n + 1), slice(None), slice(d, d + 1))
            alone = Constraint(mask[one], value[one], slack[one])
            conditioned = alone.condition(x[:, n : n + 1, :, d : d + 1], 0.4, std[:, d : d + 1])
            torch.testing.assert_close(together[:, n, :, d], conditioned[:, 0, :, 0])


def test_nothing_known_changes_nothing():
    x = torch.randn(1, 1, F, 1, generator=gen())
    nothing = Constraint(torch.zeros(1, F, 1, dtype=torch.bool), torch.zeros(1, F, 1))
    assert torch.equal(nothing.condition(x, 0.5, STD), x)
    assert x.dtype == nothing.condition(x, 0.5, STD).dtype


def segment(start=30, n=1, order=(0,), context=None):
    shape = (n, 30, 1)
    return Segment(0, start, shape, torch.tensor(order), torch.zeros(shape), context)


def test_windows_orders_and_unions():
    a, b = known_at(torch.tensor([50]), 1.0), known_at(torch.tensor([50, 55]), 2.0, slack=0.1)
    window = b.for_segment(segment(start=45))
    assert window.mask.nonzero()[:, 1].tolist() == [5, 10] and window.mask.shape == (1, 30, 1)
    assert not b.for_segment(segment(start=60)).mask.any()
    danced = b.for_segment(segment(start=45, context=torch.zeros(1, 6, 1)))
    assert danced.mask.nonzero()[:, 1].tolist() == [10]
    both = a.over(b)
    assert both.value[0, [50, 55], 0].tolist() == [1.0, 2.0]
    assert both.slack[0, [50, 55], 0].tolist() == pytest.approx([0.0, 0.1])
    pair = Constraint(
        *(torch.cat(p) for p in zip((a.mask, a.value), (b.mask, b.value), strict=True))
    )
    assert pair.for_segment(segment(n=2, order=[1, 0])).value[0, 25, 0] == 2.0


def test_errors():
    mask = torch.ones(1, 5, 1, dtype=torch.bool)
    with pytest.raises(ValueError, match=r"value has shape \(1, 4, 1\)"):
        Constraint(mask, torch.zeros(1, 4, 1))
    with pytest.raises(ValueError, match="not finite"):
        Constraint(mask, torch.full((1, 5, 1), torch.nan))
    for numbers in (mask.float(), mask.long()):
        with pytest.raises(ValueError, match=r"mask holds torch.*give mask.bool\(\)"):
            Constraint(numbers, torch.zeros(1, 5, 1))


def test_a_segment_starts_from_the_last_frames_of_its_context():
    shape, context = (2, 150, 3), torch.rand(2, 75, 3)
    segment = Segment(1, 75, shape, torch.arange(2), torch.zeros(shape), context)
    begun = InitialFrames().for_segment(segment)
    assert begun.mask.all(-1).all(0).nonzero().flatten().tolist() == list(range(67, 75))
    assert torch.equal(begun.value[:, 67:75], context[:, 67:])
    assert InitialFrames().for_segment(Segment(0, 0, shape, torch.arange(2), segment.mask)) is None
