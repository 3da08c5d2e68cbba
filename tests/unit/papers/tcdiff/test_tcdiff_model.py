"""TCDiff's second stage and the whole model: sizes, paths, dances, training, model folders."""

import pytest
import torch

from dancediff import hub
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.tcdiff_dance import OnPath, reordered
from dancediff.motion.representation import TCDIFFPP
from dancediff.music.synth import synth_song
from dancediff.papers.tcdiff.losses import TCDiffWeights
from dancediff.papers.tcdiff.model import TCDiff, TCDiffConfig
from dancediff.papers.tcdiff.navigator import roll_out
from dancediff.papers.tcdiff.trajectory_diffusion import displacement, on_path
from dancediff.training.config import TrainConfig
from dancediff.training.run import train_from_config
from dancediff.training.statistics import fit_statistics
from dancediff.training.tcdiff import TCDiffObjective

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32, "fusion_hidden": 32}
TINY |= {"path_width": 8, "path_layers": 1, "path_music": 16}
SHORT = {"num_frames": 40, "history": 24, "stride": 8}
STACKED = 876  # two frames of 438 features of music side by side, as in the public code


@pytest.fixture
def model():
    return TCDiff(TCDiffConfig(**TINY, **SHORT)).eval()


def inputs(b=2, n=3, f=20):
    path = torch.randn(b, n, f, 2)
    conditions = Conditions(torch.randn(b, f, 35), path=path)
    return torch.randn(b, n, f, 151), torch.tensor([10, 900])[:b], conditions


def count(part) -> int:
    return sum(p.numel() for p in part.parameters())


@pytest.mark.parametrize(("dancers", "weights"), [(3, 61_428_181), (4, 62_477_269)])
def test_the_published_size_has_as_many_weights_as_the_public_code(dancers, weights):
    with torch.device("meta"):
        model = TCDiff(TCDiffConfig.paper(max_dancers=dancers, music_dim=STACKED))
    assert count(model.decoder) == pytest.approx(weights, rel=0.03)
    assert count(model.navigator) == pytest.approx(1_932_122, rel=0.03)
    assert count(TCDiff()) < 3.5e6


@pytest.mark.parametrize("extensions", [(), ("preconditioning", "beat_phase")])
def test_the_root_stands_on_the_path_to_the_bit(extensions):
    model = build(TCDiff, TCDiffConfig(**TINY, **SHORT), extensions).eval()
    x_t, t, conditions = inputs()
    x_hat = model.denoise(x_t, t, conditions)
    assert torch.equal(x_hat[..., TCDIFFPP.floor], conditions.path)
    noise_there = on_path(x_t, torch.randn_like(conditions.path))
    assert torch.equal(model.denoise(noise_there, t, conditions), x_hat)
    if extensions:
        guess = model.linear_guess(x_t, t, conditions)
        assert torch.equal(guess[..., TCDIFFPP.floor], conditions.path)


def test_bodies_depend_on_the_path_the_music_and_the_others(model):
    x_t, t, conditions = inputs()
    rest = [i for i in range(151) if i not in range(4, 7)]
    plain = model(x_t, t, conditions)[..., rest]
    for changed in (
        Conditions(conditions.music, path=conditions.path + 0.5),
        Conditions(conditions.music + 1, path=conditions.path),
    ):
        assert (model(x_t, t, changed)[..., rest] - plain).abs().mean() > 1e-4
    other = x_t.clone()
    other[:, 2] += 1
    assert (model(other, t, conditions)[:, 0][..., rest] - plain[:, 0]).abs().mean() > 1e-4
    alone = model(x_t[1:], t[1:], conditions.rows(slice(1, 2)))
    assert torch.allclose(alone[..., rest], plain[1:], atol=1e-5)


def test_displacement_is_over_time_and_of_one_dancer_alone():
    path = torch.randn(1, 3, 6, 2)
    found = displacement(path)
    assert torch.equal(found[:, :, 0], torch.zeros(1, 3, 2))
    assert torch.equal(found[:, :, 1:], path[:, :, 1:] - path[:, :, :-1])
    changed = path.clone()
    changed[:, 2] += torch.randn(6, 2)
    assert torch.equal(displacement(changed)[:, :2], found[:, :2])


def test_every_weight_learns(model):
    """Those of the footwork get no gradient in the released code."""
    for layer in model.decoder.layers:  # gates start at zero, and stop the gradient of v
        torch.nn.init.normal_(layer.footwork.first.gate.weight)
    x_t, t, conditions = inputs(f=40)
    conditions = conditions.with_mask(torch.tensor([True, False]))
    guess, target = model.guessed_paths(conditions.path, conditions.music, torch.arange(2))
    (model(x_t, t, conditions).square().mean() + (guess - target).square().mean()).backward()
    assert [name for name, p in model.named_parameters() if not p.grad.any()] == []


def test_the_navigator_learns_every_part_of_a_roll_out(model):
    """What it is given, row by row, is what a roll-out gives to one that guesses the truth."""
    h, s = model.config.history, model.config.stride
    path, music = torch.randn(1, 2, 40, 2), torch.randn(1, 40, 35)
    whole = torch.cat([path[:, :, :1].expand(-1, -1, h, -1), path], dim=2)
    calls, given = [], []

    def truth(*inputs):
        calls.append(inputs)
        return whole[:, :, s * len(calls) :][:, :, :h]

    assert torch.equal(roll_out(truth, path[:, :, 0], music, history=h, stride=s), path)
    model.navigator.forward = lambda *inputs: given.extend(inputs) or inputs[0]
    part = torch.tensor([2, 0, 3, 1])
    assert len(part) == model.path_parts
    _, target = model.guessed_paths(*(x.expand(4, *x.shape[1:]) for x in (path, music)), part)
    for row, k in enumerate(part):
        assert all(torch.equal(x[row], y[0]) for x, y in zip(given, calls[k], strict=True))
        assert torch.equal(target[row], whole[0, :, s * (k + 1) :][:, :h])
    assert TCDiff(TCDiffConfig(**TINY, **SHORT | {"stride": 9})).path_parts == 4  # 0, 9, 18, 24


def test_training_meets_every_part_whatever_the_size_of_the_groups(takes, monkeypatch):
    model = TCDiff(TCDiffConfig(**TINY, **SHORT))
    objective = TCDiffObjective(model, TrainConfig(weights=TCDiffWeights()))
    windows, met = WindowSampler(takes, GroupCut(40), dancers_per_batch=3), set()
    plain = model.guessed_paths
    monkeypatch.setattr(model, "guessed_paths", lambda *x: met.update(x[2].tolist()) or plain(*x))
    for number in range(20):
        objective.losses(model, windows.batch(number), number)
    assert met == set(range(model.path_parts))


def test_paths_are_drawn_once_and_need_a_number_of_dancers(model):
    conditions = Conditions(torch.randn(2, 20, 35), swap=torch.arange(3).expand(2, 3))
    model.start.std.fill_(1.0)
    first, again, other = (
        model.with_draws(conditions, torch.Generator().manual_seed(seed)) for seed in (1, 1, 2)
    )
    assert first.path.shape == (2, 3, 20, 2) and torch.equal(first.path, again.path)
    assert not torch.equal(first.path, other.path) and not first.path.requires_grad
    assert model.with_draws(first) is first
    with pytest.raises(ValueError, match="swap=None"):
        model.with_draws(Conditions(torch.randn(2, 20, 35)))


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"x_t": torch.zeros(2, 6, 20, 151)}, "x_t has shape"),
        ({"music": torch.zeros(2, 19, 35)}, "music has shape"),
        ({"path": torch.zeros(2, 2, 20, 2)}, "path has shape"),
        ({"path": None}, "path has shape None"),
    ],
)
def test_shapes_that_do_not_fit_are_named(model, change, match):
    x_t, t, conditions = inputs()
    given = {"x_t": x_t, "music": conditions.music, "path": conditions.path} | change
    with pytest.raises(ValueError, match=match):
        model(given["x_t"], t, Conditions(given["music"], path=given["path"]))
    with pytest.raises(ValueError, match="must fit into num_frames=150"):
        TCDiffConfig(history=140)


def test_a_hook_keeps_everybody_on_the_path():
    path, x = torch.randn(2, 3, 5, 2), torch.randn(2, 3, 5, 151)
    made = OnPath(path).apply(x, 0.5)
    assert torch.equal(made[..., TCDIFFPP.floor], path)
    kept = [i for i in range(151) if i not in (4, 6)]
    assert torch.equal(made[..., kept], x[..., kept])


def test_reordering_is_undone_by_the_inverse():
    x = torch.randn(3, 4, 5, 2)
    order = torch.stack([torch.randperm(4) for _ in range(3)])
    assert torch.equal(reordered(reordered(x, order), order.argsort(1)), x)
    assert torch.equal(reordered(x, order)[1, 2], x[1, order[1, 2]])


def test_the_same_seed_gives_the_same_dance_on_its_paths():
    model = TCDiff(TCDiffConfig(**TINY, **SHORT))
    model.start.place.copy_(torch.linspace(-0.8, 0.8, 5)[None, :, None])
    model.start.std.fill_(0.1)
    song, pipeline = synth_song(3, seconds=4.0)[0], pipeline_of(model)
    options = {"dancers": 3, "steps": 2, "overlap": 20, "preset": "paper"}
    first, second = (pipeline.generate(song, seed=5, **options) for _ in range(2))
    other = pipeline.generate(song, seed=6, **options)
    assert torch.equal(first.pose, second.pose) and first.pose.shape[:2] == (3, 120)
    assert not torch.equal(first.root, other.root)
    music = model.music_normalizer.normalize(song.features())
    music = torch.cat([music, music])[: 40 + 20 * 4][None]
    paths = model.paths(music, 3, torch.Generator().manual_seed(5))[0, :, :120]
    assert torch.allclose(first.root[..., [0, 2]], paths, atol=1e-5)
    packaged = pipeline.generate(song, seed=5, **options | {"preset": "packaged"})
    assert packaged.meta["foot_contact"] and not torch.allclose(packaged.pose, first.pose)
    assert torch.allclose(packaged.root[..., [0, 2]], paths, atol=1e-5)  # feet move it nowhere


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(2, 3))


def test_statistics_know_where_groups_begin(takes, model):
    fit_statistics(model, takes)
    assert model.start.place[1, 0, 0] < model.start.place[1, 1, 0]  # ranked from left to right
    assert model.start.std[2, :3].min() > 0 and not model.start.std[3].any()


def test_the_objective_has_all_terms_and_the_same_ones_again(takes, model):
    windows = WindowSampler(takes, GroupCut(40), dancers_per_batch=6)
    objective = TCDiffObjective(model, TrainConfig(weights=TCDiffWeights()))
    first, second = (objective.losses(model, windows.batch(0), 0) for _ in range(2))
    assert {*first} == {*TCDiffWeights().terms(), "total"}
    assert all(torch.equal(first[name], second[name]) for name in first)
    weighted = sum(weight * first[name] for name, weight in TCDiffWeights().terms().items())
    assert torch.allclose(first["total"], weighted)


CONFIG = """
[data]
songs = 2
seconds = 6.0
workers = 1
dancers_per_batch = 6
[model]
class = "TCDiff"
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 32
fusion_hidden = 32
path_width = 8
path_music = 16
path_layers = 1
extensions = ["preconditioning", "aligned_attention"]
[train]
steps = 12
warmup = 2
"""


def test_a_config_trains_it_and_a_folder_holds_it(tmp_path):
    path = tmp_path / "tcdiff.toml"
    path.write_text(CONFIG)
    model = train_from_config(path, tmp_path / "run").eval()
    rows = (tmp_path / "run" / "losses.csv").read_text().splitlines()
    assert "path_distance" in rows[0] and len(rows) == 13
    again = hub.load(hub.save_model(model, tmp_path / "model", dtype=torch.float32)).model
    assert again.config == model.config and torch.equal(again.start.place, model.start.place)
    x_t, t, conditions = inputs()
    with torch.no_grad():
        assert torch.equal(model(x_t, t, conditions), again(x_t, t, conditions))
    dance = pipeline_of(again).generate(synth_song(3, seconds=6.0)[0], dancers=3, steps=2)
    assert dance.joints().isfinite().all() and dance.meta["model"] == "tcdiff"


def test_the_stride_fits_into_the_history():
    with pytest.raises(ValueError, match=r"stride=25 must lie in 1 ... 10"):
        TCDiffConfig(history=10)
