"""Bailando: units, the transformer that chooses them, actor and critic, and a dance of it all."""

import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.autoregression.unit_blocks import HISTORY
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import Batch
from dancediff.generation.autoregressive_request import BailandoRequest
from dancediff.generation.pipeline import pipeline_of
from dancediff.motion.halves import LOWER, UPPER, assemble, split
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.motion_units import REACH, UnitDecoder, Units, l_motion
from dancediff.papers.bailando.actor_critic import (
    actor_critic_losses,
    beat_reward,
    dance_beats,
    has_beat,
    td_error,
)
from dancediff.papers.bailando.gpt import CrossConditionalGPT
from dancediff.papers.bailando.model import Bailando, BailandoConfig, l_root
from dancediff.training.run import train_from_config
from places import CONFIGS

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "head_layers": 1, "ff_dim": 32}
TINY |= {"width": 16, "code_dim": 8, "num_codes": 16, "length": 7}
SMALL = "".join(f"{name} = {value}\n" for name, value in TINY.items())
CONFIG = f'[model]\nclass = "Bailando"\n{SMALL}[train]\nsteps = 3\nwarmup = 0\n'
UNITS_ONLY = "[train_gpt]\nsteps = 0\n[train_actor_critic]\nsteps = 0\n"


@pytest.fixture
def model():
    torch.manual_seed(0)
    made = Bailando(BailandoConfig(**TINY))
    made.standing = dd.choreograph([0.5, 1.0], dancers=1, seed=0, seconds=2)[0].features()[0, 0]
    for half in (made.upper, made.lower):
        half.quantizer.e.normal_()
        half.quantizer.N.fill_(1.0)
        half.quantizer.S.copy_(half.quantizer.e)
    return made.eval()


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(1, 2))


def batch(b=2, f=64):
    g = torch.Generator().manual_seed(1)
    x, M = torch.randn(b, 1, f, 151, generator=g), torch.randn(b, f, 35, generator=g)
    return Batch(x, M, torch.zeros(b, 1))


def count(*parts) -> int:
    return sum(p.numel() for part in parts for p in part.parameters())


def test_the_published_sizes_have_the_published_number_of_weights():
    """Units of places of 15 and 9 joints, 438 features of music: as in the released code."""
    sizes = {"width": 512, "code_dim": 512}
    layers = {"num_layers": 6, "head_layers": 6, "num_heads": 12, "ff_dim": 3072}
    with torch.device("meta"):
        halves = [Units(channels, num_codes=512, **sizes) for channels in (45, 27)]
        root = UnitDecoder(3, **sizes)
        gpt = CrossConditionalGPT(768, num_codes=512, length=29, music_dim=438, **layers)
        ours = Bailando(BailandoConfig.paper())
    assert count(*halves) == 51_683_400 and count(*halves, root) == 65_068_619
    assert count(gpt) == 87_032_832
    assert abs(count(ours.upper, ours.lower, ours.root) / 65_068_619 - 1) < 0.03
    assert abs(count(ours.gpt) / 87_032_832 - 1) < 0.03


def test_halves_and_root_are_all_of_the_body():
    assert sorted([*UPPER, *LOWER, 4, 5, 6]) == list(range(TCDIFFPP.dim))
    x = torch.randn(2, 20, 151)
    upper, lower, root = split(x)
    again = assemble(upper, lower, root, x[:, 0, TCDIFFPP.floor] - root[:, 0, :2] / 30)
    assert torch.allclose(again, x, atol=1e-5)
    moved = x.clone()
    moved[..., TCDIFFPP.floor] += 3
    assert torch.allclose(split(moved)[2], root, atol=1e-4)  # the same anywhere on the stage


def test_losses_by_hand():
    x, offset = torch.randn(2, 9, 3), torch.full((2, 9, 3), 0.5)
    assert l_motion(x + offset, x).item() == pytest.approx(0.5)
    ramp = torch.arange(9.0)[:, None].expand(2, 9, 3)  # velocity 1, no acceleration
    assert l_motion(x + ramp, x).item() == pytest.approx(ramp.mean().item() + 1, abs=1e-5)
    assert l_root(x + ramp, x).item() == pytest.approx(ramp.mean().item() + 1, abs=1e-5)


def test_a_frame_depends_on_units_within_reach_only(model):
    codes = torch.zeros(1, 2, 3 * REACH, dtype=torch.long)
    changed = codes.clone()
    changed[..., REACH] = 1
    dances = [model.motion(c, torch.zeros(1, 2)) for c in (codes, changed)]
    body = [4 * 0 + k for k in range(151) if k not in (4, 6)]  # places add up over time
    moves = (dances[0] - dances[1])[0][:, body].abs().amax(-1) > 0
    assert moves[8 * REACH : 8 * REACH + 8].all()
    assert not moves[8 * (2 * REACH + 1) :].any()


def gpt_change(model, what: str, half: int, time: int):
    """At which times logits of (upper, lower) move when one token does."""
    g = torch.Generator().manual_seed(3)
    codes = torch.randint(16, (2, 2, 7), generator=g)
    M = torch.randn(2, 7, 280, generator=g)
    before = model.gpt(codes, M)
    if what == "music":
        M = M.clone()
        M[:, time, :140] += 1
    else:
        codes = codes.clone()
        codes[:, half, time] = (codes[:, half, time] + 1) % 16
    return (model.gpt(codes, M) - before).abs().amax((0, 3)) > 1e-6


@pytest.mark.parametrize(("what", "half"), [("codes", 0), ("codes", 1), ("music", 0)])
def test_what_comes_later_does_not_matter_and_all_three_see_each_other(model, what, half):
    moves = gpt_change(model, what, half, time=3)
    assert not moves[:, :3].any() and moves[:, 3:].all()


def test_the_next_unit_gets_its_own_music(model):
    """The logits of unit i follow from units before i, and from the music up to i."""
    one = batch()
    codes, later = model.codes(one.x[:, 0]), one.M.unflatten(1, (8, 8)).flatten(2)[:, 1:]
    logits = model.gpt(codes[:, :, :-1], later)
    wanted = torch.nn.functional.cross_entropy(logits.flatten(0, 2), codes[:, :, 1:].flatten())
    made = model.losses(one, "gpt", torch.Generator())["total"]
    assert torch.allclose(made, wanted)
    early = one._replace(M=torch.cat([one.M[:, :8] + 1, one.M[:, 8:]], dim=1))
    assert torch.equal(model.losses(early, "gpt", torch.Generator())["total"], made)


def test_clips_of_a_batch_do_not_see_each_other(model):
    codes, M = torch.randint(16, (2, 2, 5)), torch.randn(2, 5, 280)
    assert torch.allclose(model.gpt(codes, M)[:1], model.gpt(codes[:1], M[:1]), atol=1e-5)


def test_rewards_of_the_four_cases():
    music, dance = torch.tensor([True, True, False, False]), torch.tensor([True, False] * 2)
    assert beat_reward(music, dance).tolist() == [5, -5, 5, 5]
    frames = torch.zeros(1, 24)
    frames[0, [0, 23]] = 1
    assert has_beat(frames).tolist() == [[True, False, True]]
    path = torch.cos(torch.arange(60) / 60 * 4 * torch.pi)  # turns round every 15 frames
    joints = path[None, :, None, None] * torch.ones(1, 60, 24, 3)
    assert dance_beats(joints)[0].nonzero().flatten().tolist() == [15, 30, 45]


def test_the_reward_counts_music_beats_where_they_sound(model, monkeypatch):
    """Nobody dances a beat, so the unit in which one sounds is punished: the one before it."""
    M, b = torch.zeros(1, 32, 35), 1
    M[0, 16, 34] = 1  # sounds in frame 15, the last of unit 1
    nothing = torch.zeros(b, 32)
    monkeypatch.setattr("dancediff.papers.bailando.model.dance_beats", lambda joints: nothing)
    later = M.unflatten(1, (4, 8)).flatten(2)[:, 1:]
    _, reward = model.episode(torch.zeros(b, 2, 1).long(), M, later, torch.Generator())
    assert reward.tolist() == [[-5.0, 5.0, 5.0]]


def test_temporal_differences_by_hand():
    r, V = torch.tensor([[5.0, -5.0, 5.0]]), torch.tensor([[1.0, 2.0, 4.0]], requires_grad=True)
    delta = td_error(r, V)
    assert delta.tolist() == [[6.0, -3.0, 1.0]]
    delta.sum().backward()
    assert V.grad.tolist() == [[-1.0, -1.0, -1.0]]  # none through what comes later


def test_a_good_unit_becomes_more_likely():
    logits = torch.zeros(1, 2, 1, 4, requires_grad=True)
    codes = torch.tensor([[[2], [1]]])
    for reward, sign in ((5.0, 1), (-5.0, -1)):
        V = torch.zeros(1, 1, requires_grad=True)
        terms = actor_critic_losses(logits, codes, torch.tensor([[reward]]), V)
        (g,) = torch.autograd.grad(terms["actor"], logits, retain_graph=True)
        assert -sign * g[0, 0, 0, 2] > 0 and -sign * g[0, 1, 0, 1] > 0
        assert torch.autograd.grad(terms["actor"], V, allow_unused=True)[0] is None
        assert terms["critic"].item() == 25


@pytest.mark.parametrize("stage", Bailando.stages)
def test_a_stage_changes_its_own_weights_only(model, stage):
    model.train().requires_grad_(False)
    parts = model.learning(stage)
    for part in parts:
        part.requires_grad_(True)
    book = model.lower.quantizer.e.clone()
    model.losses(batch(), stage, torch.Generator().manual_seed(0))["total"].backward()
    chosen = {id(p) for part in parts for p in part.parameters()}
    for name, p in model.named_parameters():
        assert (p.grad is not None and bool(p.grad.abs().sum() > 0)) == (id(p) in chosen), name
    assert torch.equal(book, model.lower.quantizer.e) == (stage != "units")
    if stage == "actor_critic":
        shared = {id(p) for p in model.gpt.shared.parameters()}
        assert not shared & chosen


def test_the_root_does_not_change_the_units(model):
    model.train()
    x = batch().x[:, 0]
    model.unit_losses(x, torch.Generator())["root"].backward()
    assert all(p.grad is None for p in model.lower.parameters())
    assert all(p.grad is not None and p.grad.any() for p in model.root.parameters())


def dance(model, **options):
    return pipeline_of(model).generate(dd.packaged_song(), **{"seconds": 3, "seed": 4} | options)


def test_the_likeliest_unit_alone_leaves_nothing_to_chance(model):
    greedy = [dance(model, seed=s, top_k=1, seed_noise=0.0).features() for s in (4, 5)]
    assert torch.equal(*greedy)
    how = {"seed_noise": 0.0, "top_k": 16}
    cold, warm = (dance(model, temperature=t, **how).features() for t in (0.01, 100.0))
    assert not torch.equal(cold, warm)


def test_dancers_dance_alone(model):
    trio, solo = dance(model, dancers=3), dance(model, dancers=1)
    assert torch.equal(trio.features(), dance(model, dancers=3).features())
    assert torch.allclose(trio.features()[0, :, 7:], solo.features()[0, :, 7:], atol=1e-4)
    assert not torch.allclose(trio.features()[1, :, 7:], trio.features()[0, :, 7:], atol=1e-4)
    assert not torch.equal(dance(model, seed=5).features(), trio.features())


def test_blocks_are_what_the_whole_would_be(model):
    """Units become motion block by block; the dance is that of all units at once."""
    request = BailandoRequest(seconds=20, temperature=1.0, top_k=16)
    history, M = torch.randn(1, 32, 151), torch.randn(300, 35)
    draws = torch.Generator().manual_seed(0)
    with torch.no_grad():
        blocks = torch.cat(list(model.dance(history, M, request, [draws])), dim=1)
        codes, draws = model.codes(history), draws.manual_seed(0)
        while codes.shape[-1] < HISTORY + 75:
            new = model.next_units(codes, M, request, [draws])
            codes = torch.cat([codes, new], dim=-1)
        start = history[:, -1, TCDIFFPP.floor]
        whole = model.motion(codes, start, slice(HISTORY, None))
    assert blocks.shape == (1, 600, 151)
    assert torch.allclose(blocks, whole, atol=1e-4)


def test_from_a_config_to_a_dance(tmp_path, takes):
    config = tmp_path / "bailando.toml"
    config.write_text(CONFIG)
    made = train_from_config(config, tmp_path / "run", takes=takes)
    assert made.upper.quantizer.N.sum() > 0
    hub.save_model(made, tmp_path / "model", dtype=torch.float32)
    kept = hub.load(tmp_path / "model").model
    assert torch.equal(dance(made, dancers=2).features(), dance(kept, dancers=2).features())
    x = torch.randn(1, 64, 151)
    assert torch.equal(made.codes(x), kept.codes(x))


def test_a_stopped_training_keeps_its_codebook(tmp_path, takes):
    path, rest = tmp_path / "bailando.toml", UNITS_ONLY
    path.write_text(CONFIG + rest)
    whole = train_from_config(path, tmp_path / "whole", takes=takes)
    path.write_text(CONFIG.replace("steps = 3", "steps = 2") + rest)
    train_from_config(path, tmp_path / "part", takes=takes)
    path.write_text(CONFIG + rest)
    part = train_from_config(path, tmp_path / "part", takes=takes, resume=True)
    assert torch.equal(whole.lower.quantizer.e, part.lower.quantizer.e)


def test_units_are_learned_and_used(tmp_path, takes):
    path = tmp_path / "bailando.toml"
    path.write_text(CONFIG.replace("steps = 3", "steps = 80\nlr = 3e-3\nema = 0.9") + UNITS_ONLY)
    model = train_from_config(path, tmp_path / "run", takes=takes[:1])
    rows = (tmp_path / "run" / "units" / "losses.csv").read_text().splitlines()
    column = rows[0].split(",").index("total")
    losses = [float(row.split(",")[column]) for row in rows[1:]]
    assert sum(losses[-10:]) < 0.9 * sum(losses[:10])
    codes = model.codes(model.normalizer.normalize(takes[0].x[:, :160]))
    assert min(len(codes[:, half].unique()) for half in range(2)) > 4


def test_the_small_config_can_be_read():
    from dancediff.training.autoregressive import check_autoregressive_tables
    from dancediff.training.tables import read_training

    path = CONFIGS / "bailando_tiny.toml"
    tables = check_autoregressive_tables(read_training(path), str(path))
    assert all(tables[f"train_{stage}"]["steps"] > 100 for stage in Bailando.stages)


def test_accelerations_count():
    t = torch.arange(9.0)[None, :, None]
    ramp, bend = l_motion(t, 0 * t).item(), l_motion(t.square(), 0 * t).item()
    assert ramp == pytest.approx(4 + 1 + 0)  # mean of 0 ... 8, its steps, no change of them
    assert bend == pytest.approx(204 / 9 + 8 + 2)


def test_logits_of_a_half_are_read_off_its_own_tokens():
    gpt = CrossConditionalGPT(16, num_codes=8, length=6, music_dim=9, num_layers=1, head_layers=0,
                              num_heads=2, ff_dim=32)  # fmt: skip
    h = torch.randn(1, 15, 16, requires_grad=True)
    for half in (0, 1):
        (gradient,) = torch.autograd.grad(gpt.choose(h)[:, half].sum(), h)
        read = gradient[0].abs().amax(-1).unflatten(0, (3, 5)).amax(-1) > 0
        assert read.tolist() == [False, half == 0, half == 1]


def test_a_unit_is_chosen_to_its_own_music(model, monkeypatch):
    heard = []

    def gpt(codes, M):
        heard.append(M)
        return torch.zeros(*codes.shape, 16)

    monkeypatch.delattr(model, "gpt")
    monkeypatch.setattr(model, "gpt", gpt, raising=False)
    M = torch.arange(200.0)[:, None].expand(-1, 35)
    request = BailandoRequest(temperature=1.0, top_k=1)
    codes = torch.zeros(1, 2, HISTORY + 3, dtype=torch.long)  # three units of the song are there
    model.next_units(codes, M, request, [torch.Generator()])
    last = heard[0][0, -1].unflatten(0, (8, 35))[:, 0]
    assert last.tolist() == list(range(24, 32))
