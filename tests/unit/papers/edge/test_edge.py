from dataclasses import dataclass

import numpy as np
import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.cli import main
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.take import DanceTake
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.generation.pipeline import pipeline_of
from dancediff.papers.edge.model import EDGE, SPACING, EDGEConfig, start_slots
from dancediff.papers.tcdiffpp.losses import LossWeights, tcdiffpp_losses
from dancediff.papers.tcdiffpp.model import TCDiffPPConfig
from dancediff.training.run import read_config, train_from_config
from dancediff.training.statistics import fit_statistics
from places import CONFIGS

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}


@dataclass
class Tune:
    """As much of a song as `generate` looks at."""

    duration: float = 12.0
    name: str = "tune"
    is_silent: bool = False
    peak: float = 0.5

    def features(self):
        g = torch.Generator().manual_seed(int(self.duration))
        return torch.randn(1 + int(30 * self.duration), 35, generator=g)


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    return build(EDGE, EDGEConfig(**TINY), ["preconditioning"])


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(1, 2))


def dance(model, song=None, **options):
    return pipeline_of(model).generate(song or Tune(), **{"steps": 2} | options)


def inputs(b=2, n=3, f=20):
    torch.manual_seed(1)
    S = torch.arange(n).expand(b, n)
    return torch.randn(b, n, f, 151), torch.randint(1000, (b,)), torch.randn(b, f, 35), S


def test_the_papers_sizes_have_the_published_number_of_weights():
    with torch.device("meta"):
        model = EDGE(EDGEConfig.paper())
        jukebox = EDGE(EDGEConfig.paper(music_dim=4800))
    assert sum(p.numel() for p in model.parameters()) == 47_024_791
    assert sum(p.numel() for p in jukebox.parameters()) == 49_464_471


def test_small_sizes_are_those_of_the_small_tcdiffpp():
    small, group = EDGEConfig(), TCDiffPPConfig()
    for key in ("d_model", "num_heads", "num_layers", "ff_dim", "num_frames"):
        assert getattr(small, key) == getattr(group, key), key


def test_dancers_do_not_see_each_other(model):
    x_t, t, M, S = inputs()
    x_t.requires_grad_()
    model(x_t, t, Conditions(M, S))[0, 0].sum().backward()
    reached = x_t.grad.abs().sum((2, 3)) > 0
    assert reached.tolist() == [[True, False, False], [False, False, False]]


def test_a_group_is_its_dancers_one_by_one(model):
    x_t, t, M, S = inputs()
    keep = torch.tensor([True, False])
    whole = model(x_t, t, Conditions(M, S, music_mask=keep))
    for k in range(3):
        alone = model(x_t[:, k : k + 1], t, Conditions(M, S[:, :1], music_mask=keep))
        torch.testing.assert_close(whole[:, k : k + 1], alone, atol=1e-5, rtol=1e-5)


def test_order_of_dancers_means_nothing(model):
    x_t, t, M, S = inputs()
    mirrored = model(x_t.flip(1), t, Conditions(M, S.flip(1))).flip(1)
    torch.testing.assert_close(mirrored, model(x_t, t, Conditions(M, S)), atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"x_t": torch.zeros(3, 20, 151)}, r"x_t has shape \(3, 20, 151\)"),
        ({"t": torch.zeros(3, dtype=torch.long)}, r"t has shape \(3,\)"),
        ({"M": torch.zeros(2, 30, 35)}, r"music has shape \(2, 30, 35\); expected \(2, 20, 35\)"),
    ],
)
def test_wrong_shapes_are_named(model, bad, message):
    given = dict(zip(("x_t", "t", "M", "S"), inputs(), strict=True)) | bad
    with pytest.raises(ValueError, match=message):
        model(given["x_t"], given["t"], Conditions(given["M"], given["S"]))


def test_music_and_step_matter_and_dropped_music_does_not(model):
    x_t, t, M, S = inputs()
    base = model(x_t, t, Conditions(M, S))
    assert (model(x_t, t, Conditions(-M, S)) - base).abs().max() > 1e-3
    assert (model(x_t, 999 - t, Conditions(M, S)) - base).abs().max() > 1e-3
    keep = torch.tensor([True, False])
    dropped = [model(x_t, t, Conditions(music, S, music_mask=keep)) for music in (M, -M)]
    assert torch.equal(dropped[0][1], dropped[1][1])
    assert (dropped[0][0] - dropped[1][0]).abs().max() > 1e-3


def test_four_losses_and_no_distance(model, takes):
    fit_statistics(model, [solo for take in takes for solo in take.solos(centred=True)])
    x_0 = torch.rand(2, 1, 20, 151)
    x_hat = model(x_0, torch.tensor([500, 900]), Conditions(torch.randn(2, 20, 35)))
    terms = tcdiffpp_losses(x_hat, x_hat, x_0, model.normalizer)
    assert terms["dist"] == 0
    w = LossWeights()
    four = {"simple": w.simple, "vel": w.vel, "fk": w.fk, "contact": w.contact}
    assert list(four.values()) == [0.636, 2.964, 0.646, 10.942]  # EDGE's own
    expected = sum(weight * terms[name] for name, weight in four.items())
    torch.testing.assert_close(terms["total"], expected)


def test_solos_keep_all_but_the_place():
    x = torch.randn(3, 40, 151)
    take = DanceTake("trio", x, M=torch.zeros(40, 35), group="waltz")
    solos = take.solos(centred=True)
    assert [solo.x.shape for solo in solos] == [(1, 40, 151)] * 3
    assert {solo.group for solo in solos} == {"waltz"} and all(s.M is take.M for s in solos)
    together = torch.cat([solo.x for solo in solos])
    floor = [4, 6]
    assert together[..., floor].mean(1).abs().max() < 1e-5
    torch.testing.assert_close(together[..., floor].diff(dim=1), x[..., floor].diff(dim=1))
    rest = [c for c in range(151) if c not in floor]
    assert torch.equal(together[..., rest], x[..., rest])


def apart(motion):
    """Features without the place on the stage."""
    x = motion.features()
    x[..., 4:7] -= x[:, :1, 4:7].clone()
    return x


def test_a_dancer_is_the_same_whoever_else_dances(model):
    solo, trio = dance(model, seconds=8, dancers=1), dance(model, seconds=8, dancers=3)
    torch.testing.assert_close(apart(trio)[:1], apart(solo), atol=1e-6, rtol=0)
    for i, k in ((0, 1), (0, 2), (1, 2)):
        assert (apart(trio)[i] - apart(trio)[k]).abs().max() > 1e-2  # three different dances


def test_seeds_share_no_dancer(model):
    one, two = (apart(dance(model, seconds=1, dancers=4, seed=seed)) for seed in (0, 1))
    gaps = (one[:, None] - two[None]).abs().flatten(2).amax(-1)
    assert gaps.min() > 1e-2


@pytest.mark.parametrize("dancers", [1, 2, 5, 8, np.int64(3)])
def test_dancers_start_side_by_side(model, dancers):
    start = dance(model, seconds=1, dancers=dancers).root[:, 0]
    assert start.shape == (dancers, 3)
    torch.testing.assert_close(start[:, [0, 2]], start_slots(int(dancers))[:, 0, [0, 2]])
    assert torch.allclose(start[:, 0].diff(), torch.tensor(SPACING))


@pytest.mark.parametrize(
    "seconds, frames", [(0.5, 15), (5, 150), (5.1, 153), (7.5, 225), (None, 360)]
)
def test_any_length(model, seconds, frames):
    motion = dance(model, seconds=seconds)
    assert motion.num_frames == frames and motion.joints().isfinite().all()


def test_same_seed_same_bits_whatever_ran_before(model):
    first = dance(model, seconds=8, seed=5)
    torch.randn(7)
    again = dance(model, seconds=8, seed=5)
    assert torch.equal(first.root, again.root) and torch.equal(first.pose, again.pose)


def test_options_reach_the_sampler(model):
    base = dance(model, seconds=8)
    for changed in (
        *({"guidance": 2.0}, {"eta": 1.0}, {"steps": 3}, {"overlap": 60}),
        *({"song": Tune(11.0)}, {"seed": 1}, {"dtype": torch.bfloat16}),
    ):
        assert not torch.equal(base.pose, dance(model, **{"seconds": 8} | changed).pose), changed


def test_ddpm_takes_all_steps():
    calls = []
    tiny = EDGE(EDGEConfig(**TINY, num_steps=8))
    motion = pipeline_of(tiny).generate(
        *[Tune()],
        **{"seconds": 2, "steps": 3, "sampler": "ddpm", "dancers": 2},
        progress=lambda done, total: calls.append((done, total)),
    )
    assert motion.root.isfinite().all() and calls == [(i, 16) for i in range(1, 17)]


def test_meta_says_how_it_was_made(model):
    meta = dance(model, seconds=2, seed=4).meta
    assert meta["model"] == "edge" and meta["seed"] == 4
    assert "pinning" not in meta and meta["steps"] == 2


@pytest.mark.parametrize(
    "argument, value, message",
    [
        ("dancers", 0, r"dancers=0 must be a number of at least 1"),
        ("dancers", 2.0, r"dancers=2.0 must be an integer"),
        ("steps", 0, r"steps=0 must lie in 1 \.\.\. 1000"),
        ("sampler", "euler", r"sampler='euler' is not one of"),
        (
            "swap",
            [1, 0, 2],
            r"swap=\[1, 0, 2\] is not for the model 'edge'; models of tcdiffpp have it",
        ),
        ("overlap", 150, r"overlap=150 must lie in 1 \.\.\. 149"),
        ("seconds", 13, r"seconds=13 is more than the song's 12\.00"),
        ("device", "toaster", r"device='toaster' cannot be used here"),
    ],
)
def test_bad_arguments_are_named(model, argument, value, message):
    with pytest.raises(ValueError, match=message):
        dance(model, **{argument: value})


@pytest.fixture(scope="module")
def trained(takes, tmp_path_factory):
    folder = tmp_path_factory.mktemp("edge")
    config = folder / "c.toml"
    sizes = "\n".join(f"{k} = {v}" for k, v in TINY.items())
    config.write_text(
        f'[model]\nclass = "EDGE"\n{sizes}\n[train]\nsteps = 3\n[data]\ndancers_per_batch = 4\n'
    )
    return train_from_config(config, folder / "run", takes=takes), folder


def test_it_is_trained_on_solos_by_the_same_loop(trained, takes):
    model, folder = trained
    assert isinstance(model, EDGE) and model.config.d_model == 16
    head, *rows = (folder / "run" / "losses.csv").read_text().splitlines()
    dist = head.split(",").index("dist")
    assert len(rows) == 3 and all(float(row.split(",")[dist]) == 0 for row in rows)
    assert model.normalizer.low[4] < 0 < model.normalizer.high[4]  # home is the origin
    lowest = min(take.x[..., 5].min() for take in takes)
    assert model.normalizer.low[5] <= lowest  # heights are not moved


def test_round_trip_and_command_line(trained, tmp_path, capsys):
    model, _ = trained
    folder = hub.save_model(model, tmp_path / "solo", dtype=torch.float32)
    again = dd.load(str(folder))
    assert isinstance(again.model, EDGE) and again.name == "solo"
    assert again.config == model.config
    assert torch.equal(dance(again.model, seconds=2).root, dance(model.eval(), seconds=2).root)
    args = ["generate", "packaged", "--model", str(folder), "--seconds", "1", "--steps", "2"]
    out = ["--out", str(tmp_path / "out"), "--formats", "npz", "--json"]
    assert main([*args, *out]) == 0
    assert dd.Motion.load(tmp_path / "out" / "dance.npz").num_dancers == 3
    assert main([*args, *out, "--swap", "1", "0", "2"]) == 2
    assert "swap=(1, 0, 2) is not for the model 'solo'" in capsys.readouterr().err


def test_config_mistakes_are_named(tmp_path):
    path = tmp_path / "c.toml"
    for text, words in (('class = "GPT"', "'GPT' is not one of TCDiffPP, EDGE"),):
        path.write_text(f"[train]\n[model]\n{text}\n")
        with pytest.raises(ValueError, match=words):
            read_config(path)
    path.write_text('[train]\n[model]\nclass = "EDGE"\nfp = false\n')
    with pytest.raises(ValueError, match="'model' has no 'fp'; known: class, cond_drop"):
        read_config(path)


def test_the_config_that_comes_along_is_valid_and_uses_the_same_data():
    edge, group = (read_config(CONFIGS / f"{k}_small.toml") for k in ("edge", "tcdiffpp"))
    assert edge["data"] == group["data"] and edge["train"] == group["train"]
    assert edge["model"]["class"] == "EDGE" and edge["weights"] == group["weights"]


def test_guidance_of_long_dances_begins_at_nothing(model):
    """As in the released code: the weight rises from 0, a guess without music."""
    seen = []
    hook = model.register_forward_pre_hook(lambda _, given: seen.append(given[2]))
    dance(model, seconds=8, dancers=1, guidance=2.0, steps=4)
    hook.remove()
    first, last = seen[0], seen[-1]
    assert first.music_mask is not None and not first.music_mask.any()
    assert last.music_mask is None or last.music_mask.any()
