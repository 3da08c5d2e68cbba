"""FACT: its equation, its sizes, its loss, and the way from a config to a dance."""

from dataclasses import replace

import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.cli import main
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import Batch
from dancediff.generation.pipeline import pipeline_of
from dancediff.motion.representation import TCDIFFPP
from dancediff.papers.fact.model import FACT, FACTConfig, future_loss
from dancediff.training.run import train_from_config
from places import CONFIGS

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
SMALL = "d_model = 16\nnum_heads = 2\nnum_layers = 1\nff_dim = 32\n"
CONFIG = f'[model]\nclass = "FACT"\n{SMALL}[train]\nsteps = 3\nwarmup = 0\n'


@pytest.fixture
def model():
    torch.manual_seed(0)
    made = FACT(FACTConfig(**TINY)).eval()
    made.standing = dd.choreograph([0.5, 1.0], dancers=1, seed=0, seconds=2)[0].features()[0, 0]
    return made


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(1, 2))


def inputs(b=2):
    g = torch.Generator().manual_seed(1)
    return torch.randn(b, 60, 151, generator=g), torch.randn(b, 120, 35, generator=g)


def by_hand(d, ff, layers, features, frames):
    """Weights of layers without biases of queries, keys and values, of maps and of positions."""
    layer = 4 * d * d + d + (d * ff + ff) + (ff * d + d) + 4 * d
    maps = sum(size * d + d for size in features) + d * features[0] + features[0]
    return layers * layer + maps + frames * d


def test_the_published_sizes_have_the_published_number_of_weights():
    """120,406,977, with the 225 numbers and the 60 frames a second of the released code."""
    published = {"seed_frames": 120, "music_frames": 240, "targets": 20, "motion_dim": 225}
    with torch.device("meta"):
        theirs, ours = FACT(FACTConfig.paper(**published)), FACT(FACTConfig.paper())
    count = sum(p.numel() for p in theirs.parameters())
    assert count == 120_406_977 == by_hand(800, 3072, 16, (225, 35), 360)
    assert abs(sum(p.numel() for p in ours.parameters()) / count - 1) < 0.03


def test_all_tokens_see_all_others(model):
    history, M = inputs()
    guess = model(history, M)
    for name, x in (("music", M), ("motion", history)):
        for frame in (0, -1):
            changed = x.clone()
            changed[:, frame] += 0.5
            other = model(history, changed) if name == "music" else model(changed, M)
            assert (other - guess)[:, 0].abs().max() > 1e-5, (name, frame)


def test_clips_of_a_batch_do_not_see_each_other(model):
    history, M = inputs()
    alone = model(history[:1], M[:1])
    assert torch.allclose(model(history, M)[:1], alone, atol=1e-5)


def test_a_dance_is_the_same_anywhere_on_the_stage(model):
    history, M = inputs()
    moved = history.clone()
    moved[..., TCDIFFPP.floor] += torch.tensor([2.0, -1.0])
    guess, other = model(history, M), model(moved, M)
    assert torch.allclose(other[..., 4] - guess[..., 4], torch.tensor(2.0), atol=1e-5)
    assert torch.allclose(other[..., 7:], guess[..., 7:], atol=1e-5)


def test_target_k_is_the_frame_k_after_the_history(model):
    x, M = torch.randn(2, 1, 120, 151), torch.randn(2, 120, 35)
    losses = model.losses(Batch(x, M, torch.zeros(2, 1)), "train", torch.Generator())
    guess = model(x[:, 0, :60], M)
    wanted = torch.stack([(guess[:, k] - x[:, 0, 60 + k]).square().mean() for k in range(10)])
    assert torch.allclose(losses["total"], wanted.mean())
    late = x.clone()
    late[:, :, 70:] += 1  # beyond the targets
    again = model.losses(Batch(late, M, torch.zeros(2, 1)), "train", torch.Generator())
    assert torch.equal(again["total"], losses["total"])


def test_every_weight_learns(model):
    x, M = torch.randn(2, 1, 120, 151), torch.randn(2, 120, 35)
    model.losses(Batch(x, M, torch.zeros(2, 1)), "train", torch.Generator())["total"].backward()
    assert [n for n, p in model.named_parameters() if not p.grad.abs().sum() > 0] == []
    assert future_loss(x, x) == 0


def test_wrong_shapes_are_named(model):
    history, M = inputs()
    with pytest.raises(ValueError, match="history has shape"):
        model(history[:, 1:], M)
    with pytest.raises(ValueError, match="M has shape"):
        model(history, M[:, 1:])
    with pytest.raises(ValueError, match="targets=61 is more than seed_frames=60"):
        FACT(FACTConfig(**TINY, targets=61))


def test_dancers_dance_alone(model):
    """Who dances beside somebody makes no difference; the same seed gives the same dance."""
    pipeline, song = pipeline_of(model), dd.packaged_song()
    trio = pipeline.generate(song, seconds=2, dancers=3, seed=4)
    solo = pipeline.generate(song, seconds=2, dancers=1, seed=4)
    again = pipeline.generate(song, seconds=2, dancers=3, seed=4)
    assert torch.equal(trio.features(), again.features())
    assert torch.allclose(trio.features()[0, :, 7:], solo.features()[0, :, 7:], atol=1e-4)
    assert not torch.allclose(trio.features()[1, :, 7:], trio.features()[0, :, 7:], atol=1e-4)
    pieces = list(pipeline.stream(song, seconds=2, dancers=3, seed=4))
    joined = torch.cat([piece.features() for piece in pieces], dim=1)
    assert len(pieces) == 2 and torch.allclose(joined, trio.features(), atol=1e-5)


def test_pieces_carry_nothing_over_to_the_caller(model, monkeypatch):
    """No graph that grows with the dance, and no autocast while the caller has the thread."""
    pipeline, made = pipeline_of(model), []
    motion = pipeline._motion
    monkeypatch.setattr(pipeline, "_motion", lambda x, *rest: (made.append(x), motion(x, *rest))[1])
    stream = pipeline.stream(dd.packaged_song(), seconds=2, dtype=torch.bfloat16)
    for pieces in (1, 2):
        next(stream)
        assert not made[-1].requires_grad and not torch.is_autocast_enabled("cpu")
        assert stream.is_over == (pieces == 2)
    with torch.autocast("cpu", torch.bfloat16):
        for _ in pipeline.stream(dd.packaged_song(), seconds=2):
            assert torch.is_autocast_enabled("cpu")


def test_a_dance_goes_on_from_one_that_is_given(model):
    song, seed = dd.packaged_song(), dd.choreograph([0.5, 1.0], dancers=2, seed=0, seconds=3)[0]
    how = {"seconds": 1, "seed_motion": seed, "seed_noise": 0.0}
    duo = pipeline_of(model).generate(song, dancers=2, **how)
    assert duo.num_dancers == 2 and "seed_motion" not in duo.meta
    step = torch.tensor([2.0, 0.0, -1.0])
    far = replace(seed, root=seed.root + step)
    moved = pipeline_of(model).generate(song, dancers=2, **how | {"seed_motion": far})
    begun = (moved.root - duo.root)[:, 0]
    torch.testing.assert_close(begun, step.expand(2, 3), atol=0.2, rtol=0)
    one_for_all = how | {"seed_motion": seed.dancer(0)}
    trio = pipeline_of(model).generate(song, dancers=3, **one_for_all)
    standing = pipeline_of(model).generate(song, dancers=3, seconds=1, seed_noise=0.0)
    assert trio.num_dancers == 3 and (trio.pose - standing.pose).abs().max() > 1e-3
    with pytest.raises(ValueError, match="seed_motion has 2 dancers and 90 frames"):
        pipeline_of(model).generate(song, dancers=3, **how)
    slow = how | {"seed_motion": replace(seed, fps=60.0)}
    with pytest.raises(ValueError, match="seed_motion has 60 frames a second, not 30"):
        pipeline_of(model).generate(song, dancers=2, **slow)
    with pytest.raises(ValueError, match="seed_motion is a str"):
        pipeline_of(model).generate(song, seconds=1, seed_motion="a")


@pytest.mark.parametrize(
    ("option", "words"),
    [
        ({"keep": 11}, "keep=11 must lie in 1 ... 10"),
        ({"dancers": 11}, "dancers=11 must lie in 1 ... 10"),
        ({"steps": 5}, "steps=5 is not for the model 'fact'"),
    ],
)
def test_options_are_checked(model, option, words):
    with pytest.raises(ValueError, match=words):
        pipeline_of(model).resolve(dd.packaged_song(), **option)


def test_from_a_config_to_a_dance(tmp_path, takes, capsys):
    config = tmp_path / "fact.toml"
    config.write_text(CONFIG)
    made = train_from_config(config, tmp_path / "run", takes=takes)
    assert 0.5 < made.standing[5] < 1.5  # metres: somebody who stands
    hub.save_model(made, tmp_path / "model", dtype=torch.float32)
    kept = hub.load(tmp_path / "model")
    options = {"seconds": 1, "dancers": 2, "seed": 1}
    dances = [p.generate(dd.packaged_song(), **options) for p in (pipeline_of(made), kept)]
    assert torch.equal(dances[0].features(), dances[1].features())
    command = f"generate packaged --model {tmp_path / 'model'} --seconds 1 --keep 4 --formats npz"
    assert main([*command.split(), "--out", str(tmp_path / "out")]) == 0
    assert dd.Motion.load(next((tmp_path / "out").glob("*.npz"))).meta["keep"] == 4


def test_a_stopped_training_goes_on(tmp_path, takes):
    path = tmp_path / "fact.toml"
    path.write_text(CONFIG)
    whole = train_from_config(path, tmp_path / "whole", takes=takes)
    path.write_text(CONFIG.replace("steps = 3", "steps = 2"))
    train_from_config(path, tmp_path / "part", takes=takes)
    path.write_text(CONFIG)
    resumed = train_from_config(path, tmp_path / "part", takes=takes, resume=True)
    for (name, one), other in zip(whole.named_parameters(), resumed.parameters(), strict=True):
        assert torch.equal(one, other), name


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("num_layers = 1", "layers = 1", "has no 'layers'"),
        ("steps = 3", "steps = 3\nmetrics_every = 5", "metrics_every=5 is for"),
        ("[train]", "[weights]\nvel = 1.0\n[train]", "there is no table 'weights'"),
    ],
)
def test_a_bad_config_is_refused(tmp_path, takes, old, new, words):
    path = tmp_path / "bad.toml"
    path.write_text(CONFIG.replace(old, new))
    with pytest.raises(ValueError, match=words):
        train_from_config(path, tmp_path / "run", takes=takes)


def test_it_learns_the_frames_after_a_history(tmp_path, takes):
    path = tmp_path / "fact.toml"
    path.write_text(CONFIG.replace("steps = 3", "steps = 60\nlr = 3e-3"))
    train_from_config(path, tmp_path / "run", takes=takes[:1])
    rows = (tmp_path / "run" / "train" / "losses.csv").read_text().splitlines()
    column = rows[0].split(",").index("total")
    losses = [float(row.split(",")[column]) for row in rows[1:]]
    assert losses[-1] < losses[0] / 3


def test_the_small_config_can_be_read():
    from dancediff.training.autoregressive import check_autoregressive_tables
    from dancediff.training.tables import read_training

    path = CONFIGS / "fact_tiny.toml"
    assert check_autoregressive_tables(read_training(path), str(path))["train"]["steps"] > 1000


def test_guesses_are_read_off_the_first_motion_tokens(model):
    """Without the layers that see both, music tells nothing, and frame i of motion guess i."""
    model.cross_modal = torch.nn.Identity()
    model.motion.layers = torch.nn.Identity()
    history, M = inputs()
    guess = model(history, M)
    assert torch.equal(model(history, torch.zeros_like(M)), guess)
    changed = history.clone()
    changed[:, 3, 20:] += 1
    assert (model(changed, M) - guess).abs().amax((0, 2)).nonzero().flatten().tolist() == [3]


def test_training_hears_the_music_from_the_histories_first_frame_on():
    torch.manual_seed(0)
    model = FACT(FACTConfig(**TINY, music_frames=40)).eval()  # a window has 70 frames
    g = torch.Generator().manual_seed(1)
    x, M = torch.randn(2, 1, 70, 151, generator=g), torch.randn(2, 70, 35, generator=g)
    loss = model.losses(Batch(x, M, torch.zeros(2, 1)), "train", g)["total"]
    guess = model(x[:, 0, :60], M[:, :40])
    assert torch.allclose(loss, future_loss(guess, x[:, 0, 60:]))
