"""GCD's network: sizes, symmetry, what each part depends on, dances, model folders."""

import pytest
import torch

from dancediff import hub
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.request import request_of
from dancediff.music.synth import synth_song
from dancediff.papers.gcd.consistency_critic import ConsistencyCritic
from dancediff.papers.gcd.group_modulation import GroupEmbedding, GroupModulation
from dancediff.papers.gcd.model import GCD, GCDConfig

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32}
PUBLISHED = 62_162_072  # weights of the public code with Jukebox's 4800-d music, critic included


@pytest.fixture
def model():
    return GCD(GCDConfig(**TINY)).eval()


def inputs(model, b=2, n=3, f=20):
    t = torch.tensor([10, 900])[:b]
    return torch.randn(b, n, f, 151), t, model.with_draws(Conditions(torch.randn(b, f, 35)))


def count(part) -> int:
    return sum(p.numel() for p in part.parameters())


def test_the_published_size_has_as_many_weights_as_the_public_code():
    with torch.device("meta"):
        model = GCD(GCDConfig.paper(music_dim=4800))
    assert count(model) == pytest.approx(PUBLISHED, rel=0.03)
    assert count(model.critic) == pytest.approx(11.1e6, rel=0.06)
    assert count(GCD()) < 3e6


def test_exchanged_dancers_of_the_input_are_exchanged_in_the_output(model):
    """The ambiguity that TCDiff++ writes about: only noise tells dancers apart."""
    x_t, t, conditions = inputs(model)
    order = torch.tensor([2, 0, 1])
    both = model(x_t, t, conditions), model(x_t[:, order], t, conditions)
    assert torch.allclose(both[0][:, order], both[1], atol=1e-5)
    w = model.embedding(conditions, 3)
    scores = model.critic(x_t, w, t), model.critic(x_t[:, order], w, t)
    assert torch.allclose(*scores, atol=1e-5)


def test_a_group_depends_on_nobody_else_in_the_batch_and_dancers_on_each_other(model):
    x_t, t, conditions = inputs(model)
    together = model(x_t, t, conditions)
    alone = model(x_t[1:], t[1:], conditions.rows(slice(1, 2)))
    assert torch.allclose(together[1:], alone, atol=1e-5)
    changed = x_t.clone()
    changed[:, 2] += 1
    assert not torch.allclose(model(changed, t, conditions)[:, 0], together[:, 0], atol=1e-4)


def test_music_latent_and_step_matter(model):
    x_t, t, conditions = inputs(model)
    plain = model(x_t, t, conditions)
    other_song = Conditions(conditions.music + 1, latent=conditions.latent)
    other_latent = Conditions(conditions.music, latent=conditions.latent + 1)
    masked = conditions.with_mask(torch.zeros(2, dtype=torch.bool))
    for changed in (other_song, other_latent, masked):
        assert (model(x_t, t, changed) - plain).abs().mean() > 1e-3
    assert (model(x_t, t + 50, conditions) - plain).abs().mean() > 1e-3
    no_music = Conditions(conditions.music + 1, conditions.swap, latent=conditions.latent)
    no_music = no_music.with_mask(masked.music_mask)
    assert torch.allclose(model(x_t, t, masked), model(x_t, t, no_music), atol=1e-6)


def test_the_latent_follows_from_the_generator(model):
    M = Conditions(torch.zeros(2, 9, 35))
    first, second = (
        model.with_draws(M, torch.Generator().manual_seed(seed)).latent for seed in (3, 3)
    )
    assert torch.equal(first, second) and first.shape == (2, 16)
    given = model.with_draws(M, torch.Generator().manual_seed(4))
    assert not torch.equal(given.latent, first) and model.with_draws(given) is given


def test_every_weight_learns(model):
    """But the last biases before a modulation, which takes a channel's mean out."""
    x_t, t, conditions = inputs(model)
    conditions = conditions.with_mask(torch.tensor([True, False]))
    x_hat = model(x_t, t, conditions)
    (x_hat.square().mean() + model.critic(x_t, model.embedding(conditions, 3), t).sum()).backward()
    still = {name for name, p in model.named_parameters() if p.grad.abs().max() <= 1e-6}
    biases = {n for n, _ in model.named_parameters() if n.endswith("group.feed_forward.3.bias")}
    assert still == biases


def test_modulation_sets_mean_and_spread_of_every_channel_of_the_whole_group():
    modulation = GroupModulation(8)
    w, h = torch.randn(2, 8), 5 + 3 * torch.randn(2, 3, 40, 8)
    scale, shift = modulation.scale_and_shift(w).chunk(2, dim=-1)
    made = modulation(h, w)
    assert torch.allclose(made.mean((1, 2)), shift, atol=1e-5)
    assert torch.allclose(made.std((1, 2), correction=0), (1 + scale).abs(), atol=1e-4)


def test_the_embedding_keeps_the_spread_of_latents_and_knows_the_number():
    embed = GroupEmbedding(64, max_dancers=5)
    music = torch.randn(1, 9, 64).expand(200, -1, -1)
    w = embed(torch.randn(200, 64), music, 3)
    assert 0.2 < w.std(0).mean() < 3
    assert not torch.allclose(embed(None, music[:1], 2), embed(None, music[:1], 3))


def test_the_critic_is_told_the_step():
    critic = ConsistencyCritic(16, 5, motion_dim=151, num_layers=1, num_heads=2, ff_dim=32).eval()
    x_t, w = torch.randn(1, 2, 8, 151), torch.randn(1, 16)
    scores = [critic(x_t, w, torch.tensor([t])).item() for t in (0, 500)]
    assert abs(scores[0] - scores[1]) > 1e-4
    assert abs(critic(x_t.flip(2), w, torch.tensor([0])).item() - scores[0]) > 1e-4


def test_the_critics_score_depends_on_the_group():
    """The mean of tokens whose mean the modulation has just set would not."""
    critic = ConsistencyCritic(16, 5, motion_dim=151, num_layers=1, num_heads=2, ff_dim=32).eval()
    w, t = torch.randn(1, 16).expand(40, 16), torch.full((40,), 10)
    scores = critic(torch.randn(40, 2, 8, 151), w, t)
    assert scores.std() > 1e-3


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"x_t": torch.zeros(2, 6, 20, 151)}, "x_t has shape"),
        ({"x_t": torch.zeros(3, 20, 151)}, r"x_t has shape \(3, 20, 151\)"),
        ({"t": torch.zeros(3, dtype=torch.long)}, r"t has shape \(3,\)"),
        ({"music": torch.zeros(2, 19, 35)}, "music has shape"),
        ({"latent": torch.zeros(2, 3)}, "latent has shape"),
    ],
)
def test_shapes_that_do_not_fit_are_named(model, change, match):
    x_t, t, conditions = inputs(model)
    given = {"x_t": x_t, "t": t, "music": conditions.music, "latent": conditions.latent} | change
    with pytest.raises(ValueError, match=match):
        model(given["x_t"], given["t"], Conditions(given["music"], latent=given["latent"]))


def test_the_same_seed_gives_the_same_dance_and_gamma_changes_it():
    pipeline = pipeline_of(GCD(GCDConfig(**TINY)))
    song = synth_song(3, seconds=9.0)[0]
    options = {"dancers": 3, "steps": 2, "seed": 5, "foot_contact": False}
    first, second = (pipeline.generate(song, **options) for _ in range(2))
    assert torch.equal(first.pose, second.pose) and first.pose.shape[:2] == (3, 270)
    dialled = pipeline.generate(song, gamma=20.0, **options)
    assert not torch.equal(first.pose, dialled.pose)  # by how much, weights decide that are drawn
    assert (first.meta["gamma"], dialled.meta["gamma"]) == (0.0, 20.0)
    assert first.meta["seams"] == [150, 225] and first.meta["model"] == "gcd"


def test_one_latent_serves_all_segments():
    model, seen = GCD(GCDConfig(**TINY)), []
    model.register_forward_pre_hook(lambda _, given: seen.append(given[2].latent))
    pipeline_of(model).generate(synth_song(3, seconds=9.0)[0], dancers=3, steps=2)
    z = torch.cat(seen)
    assert len(z) >= 3 and torch.equal(z, z[:1].expand_as(z))


@pytest.mark.parametrize("extensions", [(), ("preconditioning", "beat_phase", "aligned_attention")])
def test_a_model_folder_holds_all_of_it(tmp_path, extensions):
    model = build(GCD, GCDConfig(**TINY), extensions)
    again = hub.load(hub.save_model(model, tmp_path / "gcd", dtype=torch.float32)).model
    assert again.config == model.config and again.extensions == tuple(extensions)
    x_t, t, conditions = inputs(again)
    assert torch.equal(model.eval()(x_t, t, conditions), again(x_t, t, conditions))


def test_gamma_belongs_to_gcd_and_has_limits():
    with pytest.raises(ValueError, match=r"gamma=1 is not for the model 'edge'.*models of gcd"):
        request_of("edge", "edge", {"gamma": 1})
    with pytest.raises(ValueError, match="gamma=101 must lie in -100"):
        pipeline_of(GCD(GCDConfig(**TINY))).resolve(synth_song(3, seconds=5.0)[0], gamma=101)
