"""CoDancers: who sees whom, rare units, and a group dance."""

from types import SimpleNamespace

import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.autoregression.unit_blocks import BLOCK
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import Batch
from dancediff.generation.pipeline import pipeline_of
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.motion_units import REACH
from dancediff.papers.codancers.choice import focal_loss, reweighted
from dancediff.papers.codancers.model import CoDancers, CoDancersConfig
from dancediff.training.run import train_from_config
from places import CONFIGS

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
TINY |= {"width": 16, "code_dim": 8, "num_codes": 16, "length": 7}
SMALL = "".join(f"{name} = {value}\n" for name, value in TINY.items())
CONFIG = f'[model]\nclass = "CoDancers"\n{SMALL}[train]\nsteps = 3\nwarmup = 0\n'


def made(**changes):
    torch.manual_seed(0)
    model = CoDancers(CoDancersConfig(**TINY | changes))
    model.standing = dd.choreograph([0.5, 1.0], dancers=1, seed=0, seconds=2)[0].features()[0, 0]
    for units in model.units:
        units.quantizer.e.normal_()
        units.quantizer.N.fill_(1.0)
        units.quantizer.S.copy_(units.quantizer.e)
    return model.eval()


@pytest.fixture
def model():
    return made()


def batch(b=2, n=3, f=64):
    g = torch.Generator().manual_seed(1)
    x, M = torch.randn(b, n, f, 151, generator=g), torch.randn(b, f, 35, generator=g)
    return Batch(x, M, torch.zeros(b, n))


def moves(model, dancer: int, time: int):
    """Whose logits at which times move when one dancer's unit does: bool (n, u), clip 0 and 1."""
    g = torch.Generator().manual_seed(3)
    codes = torch.randint(16, (2, 3, 3, 6), generator=g)
    places, M = torch.randn(2, 3, 6, 3, generator=g), torch.randn(2, 6, 280, generator=g)
    changed = codes.clone()
    changed[0, dancer, :, time] = (codes[0, dancer, :, time] + 1) % 16
    difference = model.gpt(changed, places, M) - model.gpt(codes, places, M)
    found = difference.abs().amax((2, 4)) > 1e-6
    assert not found[1].any(), "another clip of the batch"
    return found[0]


@pytest.mark.parametrize("dancer", [0, 1, 2])
def test_dancers_see_those_before_them_and_nothing_that_comes_later(model, dancer):
    """In the released code a unit of dancer 0 changes the next clip, and no other dancer."""
    found = moves(model, dancer, time=2)
    assert not found[:, :2].any() and not found[:dancer].any()
    assert found[dancer:, 2:].all()


def test_together_all_see_all():
    found = moves(made(joint=True), dancer=2, time=2)
    assert not found[:, :2].any() and found[:, 2:].all()


def test_focal_loss_is_cross_entropy_without_its_exponent():
    logits, codes = torch.randn(2, 5, 8), torch.randint(8, (2, 5))
    plain = torch.nn.functional.cross_entropy(logits.flatten(0, 1), codes.flatten())
    assert torch.allclose(focal_loss(logits, codes, alpha=1.0, gamma=0.0), plain)
    sure = torch.tensor([[4.0, 0.0]])
    code = torch.tensor([0])
    p = sure.softmax(-1)[0, 0]
    assert torch.allclose(focal_loss(sure, code), 0.6 * (1 - p) ** 2 * -p.log())


def test_reweighting():
    p, seen = torch.tensor([0.5, 0.3, 0.15, 0.05]), torch.tensor([0.7, 0.1, 0.1, 0.1])
    ratio = p / seen
    assert torch.allclose(reweighted(p, seen, 1e-4), ratio / ratio.sum(), atol=1e-3)
    assert torch.allclose(reweighted(p, seen, 1e30), torch.full((4,), 0.25), atol=0.02)
    even = reweighted(p, torch.full((4,), 0.25), 50.0)
    assert (even.diff() < 0).all() and torch.allclose(even.sum(), torch.tensor(1.0))
    assert reweighted(p, seen, 50.0)[0] < even[0]
    assert reweighted(p, torch.tensor([1.0, 0, 0, 0]), 50.0).isfinite().all()


def test_the_next_units_get_their_own_music(model):
    one = batch()
    before = model.losses(one, "gpt", torch.Generator())["total"]
    M = one.M.clone()
    M[:, :8] += 1  # music of the first unit, which is not chosen
    assert torch.equal(model.losses(one._replace(M=M), "gpt", torch.Generator())["total"],
                       before)  # fmt: skip
    M[:, -8:] += 1
    assert not torch.equal(model.losses(one._replace(M=M), "gpt", torch.Generator())["total"],
                           before)  # fmt: skip


def test_a_root_goes_where_its_velocity_takes_it(model):
    codes = torch.randint(16, (1, 2, 3, 5))
    start = torch.tensor([[[1.0, 2.0], [-3.0, 0.5]]])
    x = model.motion(codes, start)
    roots = model.units[2].motion(codes[0, :, 2])
    floor = start[0][:, None] + roots[..., :2].cumsum(1) / 30
    assert torch.allclose(x[0, ..., TCDIFFPP.floor], floor, atol=1e-5)
    assert torch.allclose(x[0, ..., TCDIFFPP.height], roots[..., 2])


@pytest.mark.parametrize("stage", CoDancers.stages)
def test_a_stage_changes_its_own_weights_only(model, stage):
    model.train().requires_grad_(False)
    for part in model.learning(stage):
        part.requires_grad_(True)
    shares = model.shares.clone()
    model.losses(batch(), stage, torch.Generator().manual_seed(0))["total"].backward()
    chosen = {id(p) for part in model.learning(stage) for p in part.parameters()}
    for name, p in model.named_parameters():
        learned = p.grad is not None and bool(p.grad.abs().sum() > 0)
        assert learned == (id(p) in chosen), name
    assert torch.equal(shares, model.shares) == (stage == "units")
    assert torch.allclose(model.shares.sum(-1), torch.ones(3))


def dance(model, **options):
    return pipeline_of(model).generate(dd.packaged_song(), **{"seconds": 3, "seed": 4} | options)


def test_a_group_dance_can_be_repeated(model):
    trio, again = dance(model, dancers=3), dance(model, dancers=3)
    assert torch.equal(trio.features(), again.features()) and trio.num_frames == 90
    duo = dance(model, dancers=2).features()
    assert not torch.equal(dance(model, dancers=3, seed=5).features(), trio.features())
    assert duo.shape == (2, 90, 151)
    with pytest.raises(ValueError, match="dancers=6 must lie in 1"):
        dance(model, dancers=6)


def test_units_that_training_met_often_are_drawn_less_often_with_reweighting():
    model, share = made(), {}
    model.shares.fill_(1e-3)
    model.shares[:, 0] = 1 - 15e-3
    g = torch.Generator().manual_seed(7)
    codes, places = torch.randint(16, (1, 5, 3, 6), generator=g), torch.zeros(1, 5, 6, 3)
    for theta in (0.0, 50.0):
        request = SimpleNamespace(reweight=theta, temperature=1.0, top_k=16)
        generators = [torch.Generator().manual_seed(k) for k in range(5)]
        drawn = [
            model.next_units(codes, places, torch.zeros(90, 35), request, generators)
            for _ in range(60)
        ]
        share[theta] = (torch.cat(drawn) == 0).double().mean().item()
    assert share[0.0] > 0.02 and share[50.0] < 0.2 * share[0.0]
    assert dance(model, dancers=2, reweight=0.0).meta["reweight"] == 0


def test_the_likeliest_unit_alone_leaves_nothing_to_chance(model):
    how = {"dancers": 2, "seed_noise": 0.0}
    greedy = [dance(model, seed=s, top_k=1, **how).features() for s in (4, 5)]
    assert torch.equal(*greedy)
    cold, warm = (dance(model, temperature=t, **how).features() for t in (0.01, 100.0))
    assert not torch.equal(cold, warm)


def test_whoever_stands_left_is_the_first_in_a_dance_too(model):
    """Training ranks windows; so the network must not see that dancers changed places."""
    g = torch.Generator().manual_seed(7)
    codes, places = torch.randint(16, (1, 3, 3, 6), generator=g), torch.randn(1, 3, 6, 3)
    places[0, :, 0, 0] = torch.tensor([0.5, -1.0, 2.0])
    M, request = torch.randn(90, 35), SimpleNamespace(reweight=0.0, temperature=1.0, top_k=1)
    rank = torch.tensor([1, 0, 2])

    def chosen(order):
        how = (codes[:, order], places[:, order], M, request, [None] * 3)
        return model.next_units(*how)

    assert torch.equal(chosen(rank), chosen(torch.arange(3))[:, rank])
    moved = places.clone()
    moved[0, :, 0, 0] = torch.tensor([2.0, -1.0, 0.5])
    seen = []
    model.gpt.register_forward_pre_hook(lambda gpt, given: seen.append(given))
    for where in (places, moved):
        model.next_units(codes, where, M, request, [None] * 3)
    assert torch.equal(seen[0][0], codes[:, [1, 0, 2]])
    assert torch.equal(seen[1][0], codes[:, [1, 2, 0]])
    assert torch.equal(seen[1][1], moved[:, [1, 2, 0]])


def test_dancers_know_where_they_have_danced(model, monkeypatch):
    known = []
    plain = model.next_units

    def next_units(codes, places, *rest):
        known.append(places)
        return plain(codes, places, *rest)

    monkeypatch.setattr(model, "next_units", next_units)
    request = SimpleNamespace(frames=600, reweight=50.0, temperature=1.0, top_k=16)
    M = model.music_normalizer.normalize(dd.packaged_song().features())
    history = model.standing.expand(2, model.history_frames, -1) + torch.randn(2, 1, 151) * 0.1
    generators = [torch.Generator().manual_seed(k) for k in range(2)]
    made = torch.cat(list(model.dance(history, M, request, generators)), dim=1)
    true = made[:, 7::8, TCDIFFPP.root]
    last = known[-1][0, :, 4:]  # after the units before the song
    finished = true.shape[1] - REACH - BLOCK  # at least so many were motion by then
    assert torch.equal(last[:, :finished], true[:, :finished])


def test_from_a_config_to_a_dance(tmp_path):
    takes = choreographed_takes(0, seconds=6.0, sizes=(1, 2, 3))
    config = tmp_path / "codancers.toml"
    config.write_text(CONFIG)
    model = train_from_config(config, tmp_path / "run", takes=takes)
    assert not torch.allclose(model.shares, torch.full_like(model.shares, 1 / 16))
    hub.save_model(model, tmp_path / "model", dtype=torch.float32)
    kept = hub.load(tmp_path / "model").model
    assert torch.equal(dance(model, dancers=2).features(), dance(kept, dancers=2).features())


def test_the_published_sizes_can_be_built_and_counted():
    """159.2 M were counted in the released transformer, of which about 55 M do nothing."""
    with torch.device("meta"):
        model = CoDancers(CoDancersConfig.paper())
    count = sum(p.numel() for p in model.gpt.parameters())
    layer = 4 * (768**2 + 768) + 2 * 768 * 3072 + 3072 + 768 + 4 * 768
    maps = 3 * 128 + 128 + 128 * 768 + 768 + 280 * 768 + 768 + 30 * 768 + 7 * 768
    out = 2 * 768 + 768**2 + 768 + 768 * 3 * 768 + 3 * 768
    assert count == 14 * layer + 3 * 768**2 + maps + out
    assert abs(count / (159.2e6 - 55e6) - 1) < 0.03


def test_the_small_config_can_be_read():
    from dancediff.training.autoregressive import check_autoregressive_tables
    from dancediff.training.tables import read_training

    path = CONFIGS / "codancers_tiny.toml"
    tables = check_autoregressive_tables(read_training(path), str(path))
    assert all(tables[f"train_{stage}"]["steps"] > 100 for stage in CoDancers.stages)
