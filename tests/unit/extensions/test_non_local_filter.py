import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.extensions.non_local_filter import HEADS, NonLocalFilter, body_parts, residual_of
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 48}


def make(d=16, motion_dim=151):
    torch.manual_seed(0)
    some = NonLocalFilter(d, motion_dim)
    for weights in some.mix.parameters():
        torch.nn.init.normal_(weights)
    return some


def by_loops(module, tokens, guess, residual):
    """The equation, entry by entry."""
    A = module.weights(tokens)
    mix = module.mix(module.norm(tokens))
    d = guess.shape[-1]
    count = mix.shape[-1] // (2 * HEADS)
    out = torch.zeros_like(guess)
    for h in range(HEADS):
        for c in range(d):
            part = int(module.features[:, c].argmax())
            u = mix[..., h * count + part]
            v = mix[..., (HEADS + h) * count + part]
            smooth = (A[:, :, h] @ guess[..., c, None])[..., 0]
            kept = (A[:, :, h] @ residual[..., c, None])[..., 0]
            out[..., c] += u * (smooth - guess[..., c]) + v * kept
    return out


def test_is_its_equation():
    module = make(motion_dim=25)
    tokens, guess, residual = (torch.randn(2, 3, 9, d) for d in (16, 25, 25))
    with torch.no_grad():
        expected = by_loops(module, tokens, guess, residual)
        torch.testing.assert_close(module(tokens, guess, residual), expected, atol=1e-4, rtol=1e-4)


def test_weights_are_averages_and_short_heads_stay_near():
    A = make().weights(torch.zeros(1, 1, 60, 16))
    torch.testing.assert_close(A.sum(-1), torch.ones(A.shape[:-1]))
    away = (torch.arange(60)[:, None] - torch.arange(60)).abs()
    reach = (A * away).sum(-1)[0, 0, :, 30]
    assert (reach.diff() > 0).all()


def test_dancers_do_not_mix_and_features_keep_apart():
    module = make()
    tokens, guess, residual = (torch.randn(1, 3, 12, d) for d in (16, 151, 151))
    before = module(tokens, guess, residual)
    other = guess.clone()
    other[0, 1, :, 20] += 1 + torch.arange(12)
    changed = (module(tokens, other, residual) != before).any(dim=2)[0]
    assert changed.nonzero().tolist() == [[1, 20]]


def test_parts_are_contacts_root_and_joints():
    parts = body_parts(151)
    assert parts[:7].tolist() == [0, 0, 0, 0, 1, 1, 1]
    assert parts[7:].reshape(24, 6).unique(dim=1).tolist() == [[k] for k in range(2, 26)]


def test_the_residual_fades_with_the_signal():
    x_t, guess = torch.randn(2, 1, 5, 25), torch.zeros(2, 1, 5, 25)
    residual = residual_of(x_t, guess, torch.tensor([1.0, 0.0]))
    assert torch.equal(residual[0], x_t[0]) and not residual[1].any()


def test_adds_nothing_before_training_and_learns():
    torch.manual_seed(0)
    names = ["preconditioning", "non_local_filter"]
    model = build(TCDiffPP, TCDiffPPConfig(**SIZES), names)
    x = torch.randn(2, 3, 20, 151), torch.tensor([10, 400])
    conditions = Conditions(torch.randn(2, 20, 35), torch.arange(3).expand(2, 3))
    with torch.no_grad():
        x_raw, _ = model(*x, conditions)
        part = model.parts.pop("non_local_filter")
        assert torch.equal(model(*x, conditions)[0], x_raw)
        model.parts["non_local_filter"] = part
    torch.nn.init.normal_(part.mix.weight)
    model(*x, conditions)[1].square().mean().backward()
    assert all(p.grad is not None and p.grad.abs().max() > 0 for p in part.parameters())


def test_needs_the_linear_guess():
    with pytest.raises(ValueError, match="'non_local_filter' needs 'preconditioning'"):
        build(TCDiffPP, TCDiffPPConfig(**SIZES), ["non_local_filter"])


def test_learns_to_smooth_rests_and_to_leave_jumps():
    """At most 0.6 of the error of the best filter that is the same in every frame."""
    g = torch.Generator().manual_seed(0)
    beat = (torch.arange(48) % 16 >= 12).float()  # twelve frames of rest, four of motion

    def batch(b):
        steps = beat * torch.randn(b, 25, 48, generator=g)
        x = steps.cumsum(-1).mT[:, None] / 2
        noise = 0.3 * torch.randn(x.shape, generator=g)
        wave = torch.stack([beat, torch.arange(48) % 16 / 16], -1)
        return x, x + noise, torch.cat([wave, torch.zeros(48, 14)], -1).expand(b, 1, 48, 16)

    x, noisy, tokens = batch(400)
    inputs = torch.stack([noisy.roll(k, 2) for k in range(-4, 5)], -1)[:, :, 4:-4].flatten(0, -2)
    target = x[:, :, 4:-4].flatten()
    best = torch.linalg.lstsq(inputs, target[:, None]).solution
    linear = (inputs @ best - target[:, None]).square().mean()
    torch.manual_seed(0)
    module = NonLocalFilter(16, 25)
    optimizer = torch.optim.Adam(module.parameters(), lr=0.02)
    for _ in range(300):
        x, noisy, tokens = batch(32)
        error = noisy + module(tokens, noisy, torch.zeros_like(noisy)) - x
        optimizer.zero_grad()
        error[:, :, 4:-4].square().mean().backward()
        optimizer.step()
    x, noisy, tokens = batch(100)
    with torch.no_grad():
        error = noisy + module(tokens, noisy, torch.zeros_like(noisy)) - x
    assert error[:, :, 4:-4].square().mean() < 0.6 * linear
