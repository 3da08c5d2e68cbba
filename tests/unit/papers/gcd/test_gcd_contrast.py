"""GCD's contrast and its dial: negatives, InfoNCE, the step along the critic's gradient."""

import math

import pytest
import torch

from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.diffusion.ddpm import ddpm_step
from dancediff.diffusion.samplers import SamplerOptions, sample, sampling_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.papers.gcd.consistency_guidance import consistency_guided
from dancediff.papers.gcd.contrast import info_nce, negative_groups
from dancediff.papers.gcd.losses import GCDWeights
from dancediff.papers.gcd.model import GCD, GCDConfig
from dancediff.training.config import TrainConfig
from dancediff.training.gcd import GCDObjective
from dancediff.training.run import train_from_config

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
ABAR = cosine_abar()


def test_a_negative_differs_and_consists_of_dancers_of_the_batch():
    x = torch.randn(4, 3, 5, 2)
    mixed = negative_groups(x, torch.Generator().manual_seed(1))
    replaced = (mixed != x).flatten(2).any(2)
    assert replaced.any(1).all()
    dancers = x.flatten(0, 1)
    for b, n in replaced.nonzero().tolist():
        source = (dancers == mixed[b, n]).flatten(1).all(1).nonzero()
        assert source.numel() == 1 and source.item() // 3 != b  # one of another group


def test_half_of_the_dancers_are_replaced_beside_the_one_who_always_is():
    x = torch.randn(2, 4, 1, 1).repeat(500, 1, 1, 1) + torch.rand(1000, 1, 1, 1)
    mixed = negative_groups(x, torch.Generator().manual_seed(2))
    assert (mixed != x).float().mean() == pytest.approx(1 / 4 + 3 / 4 / 2, abs=0.03)


def test_one_group_has_no_strangers():
    with pytest.raises(ValueError, match="x has 1 group"):
        negative_groups(torch.zeros(1, 2, 3, 4))


def test_info_nce():
    zero = torch.zeros(3)
    assert info_nce(zero, torch.zeros(3, 10)).item() == pytest.approx(math.log(11))
    higher = [info_nce(zero + f, torch.zeros(3, 10)).item() for f in (0.0, 1.0, 5.0, 50.0)]
    assert higher == sorted(higher, reverse=True) and higher[-1] < 1e-6
    by_hand = -math.log(math.exp(0.3) / (math.exp(0.3) + math.exp(0.1) + math.exp(-2.0)))
    found = info_nce(torch.tensor([0.3]), torch.tensor([[0.1, -2.0]]))
    assert found.item() == pytest.approx(by_hand)


def test_gamma_0_is_the_plain_sampler_to_the_bit():
    def denoise(x_t, t):
        return 0.5 * x_t

    assert consistency_guided(denoise, None, 0.0, ABAR, [1, -1]) is denoise


@pytest.mark.parametrize("gamma", [-0.5, 0.5])
def test_the_mean_of_a_step_moves_by_gamma_times_the_variance_times_the_gradient(gamma):
    """f = -x^2 / 2 has the gradient -x; beta is small, where both variances of DDPM agree."""
    t, x_t = 500, torch.randn(1, 2, 3, 4, dtype=torch.float64)
    guess = 0.3 * x_t

    def score(x, t):
        return -0.5 * x.square().flatten(1).sum(1)

    moved = consistency_guided(lambda x, t: guess, score, gamma, ABAR, [t, t - 1])(x_t, t)

    def mean(x_0):  # under the same noise each time
        return ddpm_step(x_t, x_0, t, ABAR, generator=torch.Generator().manual_seed(0))

    a, a_next = ABAR[t].item(), ABAR[t - 1].item()
    variance = (1 - a_next) / (1 - a) * (1 - a / a_next)
    change = mean(moved) - mean(guess)
    assert torch.allclose(change, -gamma * variance * x_t, rtol=0.01)


def test_gamma_works_in_inference_mode_and_pulls_towards_higher_scores():
    def score(x, t):
        return -x.square().flatten(1).sum(1)

    sizes = {}
    with torch.inference_mode():
        for gamma in (-0.2, 0.0, 0.2):
            times = sampling_times("ddim", 10, ABAR)
            run = consistency_guided(lambda x_t, t: 0.5 * x_t, score, gamma, ABAR, times)
            options = SamplerOptions(ABAR, "ddim", 10, eta=0.0, clamp=3.0)
            x = sample(run, (4, 2, 5, 3), options, generator=torch.Generator().manual_seed(0))
            sizes[gamma] = x.square().mean().item()
    assert sizes[-0.2] > sizes[0.0] > sizes[0.2]


@pytest.fixture(scope="module")
def windows():
    takes = choreographed_takes(0, seconds=6.0, sizes=(2,)) + choreographed_takes(
        1, seconds=6.0, sizes=(2,)
    )
    return WindowSampler(takes, GroupCut(30), dancers_per_batch=8)


def test_the_objective_has_all_terms_and_the_same_ones_again(windows):
    model = GCD(GCDConfig(**TINY, num_frames=30, negatives=3))
    objective = GCDObjective(model, TrainConfig(weights=GCDWeights()))
    first, second = (objective.losses(model, windows.batch(0), 0) for _ in range(2))
    assert {*first} == {"simple", "vel", "fk", "contact", "contrast", "total"}
    assert all(torch.equal(first[name], second[name]) for name in first)
    weighted = sum(weight * first[name] for name, weight in GCDWeights().terms().items())
    assert torch.allclose(first["total"], weighted)
    alone = windows.batch(0)
    alone = type(alone)(*(None if part is None else part[:1] for part in alone))
    assert objective.losses(model, alone, 0)["contrast"] == 0


def test_strangers_are_judged_as_noisy_and_for_the_same_w_as_their_group(windows):
    """So this critic cannot tell any of them from the group; dances of zeros show their noise."""
    model, batch, seen = GCD(GCDConfig(**TINY, num_frames=30, negatives=3)), windows.batch(0), []
    batch = batch._replace(x=torch.zeros_like(batch.x))

    def score(x, w, t):
        seen.append((x, t))
        return t.float() + 100 * w[:, 0]

    model.critic.forward = score
    losses = GCDObjective(model, TrainConfig(weights=GCDWeights())).losses(model, batch, 0)
    assert losses["contrast"].item() == pytest.approx(math.log(4), abs=1e-3)
    x, t = seen[0]
    assert len(x) == 4 * len(batch.x) and len(t.unique()) > 1
    noise = (1 - model.abar[t]).sqrt().float()
    torch.testing.assert_close(x.flatten(1).std(1), noise, rtol=0.05, atol=0)


@pytest.mark.slow
def test_the_critic_learns_to_tell_groups_from_strangers(windows):
    model = GCD(GCDConfig(**TINY, num_frames=30, negatives=3))
    objective = GCDObjective(model, TrainConfig(weights=GCDWeights()))
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    found = []
    for number in range(120):
        loss = objective.losses(model, windows.batch(number), number)["contrast"]
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        found.append(loss.item())
    assert sum(found[-30:]) < 0.9 * sum(found[:30])


CONFIG = """
[data]
songs = 2
seconds = 6.0
workers = 1
dancers_per_batch = 10
[model]
class = "GCD"
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 32
extensions = ["preconditioning"]
[train]
steps = 12
warmup = 2
[weights]
contrast = 0.01
"""


def test_a_config_trains_it(tmp_path):
    path = tmp_path / "gcd.toml"
    path.write_text(CONFIG)
    model = train_from_config(path, tmp_path / "run")
    rows = (tmp_path / "run" / "losses.csv").read_text().splitlines()
    assert "contrast" in rows[0] and len(rows) == 13
    assert isinstance(model, GCD)
    path.write_text(CONFIG.replace("contrast = 0.01", "dist = 1.0"))
    with pytest.raises(ValueError, match="dist"):
        train_from_config(path, tmp_path / "other")
