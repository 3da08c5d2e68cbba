"""Decisions about how Lodge is trained and sampled, one test each.

The numbers are those of the lines of docs/differences.md on Lodge.
"""

import inspect

import pytest
import torch
from safetensors.torch import load_file

from dancediff.data.take import DanceTake
from dancediff.metrics.rows import ALIKE, METRICS
from dancediff.motion.representation import with_hands
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.losses import l_critic, l_genre
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.lodge.parallel import GLOBALS, Sampling, sample_rows, style_tokens
from dancediff.training import lodge

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
GENRES = ("hiphop", "salsa")
TABLES = {
    "data": {"windows_per_batch": 2},
    "global_stage": TINY | {"music_frames": 256, "local_frames": 64, "genres": GENRES},
    "local_stage": TINY | {"num_frames": 64, "genres": GENRES},
    "train": {"steps": 4, "warmup": 0},
}


@pytest.fixture(scope="module")
def solos():
    g = torch.Generator().manual_seed(0)
    t = torch.arange(300.0)[:, None] / 30
    x = 0.1 * torch.sin(t * (1 + 4 * torch.rand(139, generator=g)))
    x[:, [7, 11]] += 1
    M = torch.rand(300, 35, generator=g)
    return [DanceTake("made", with_hands(x)[None], M=M, genre="salsa")]


def test_l03_as_many_steps_in_each_stage():
    model = Lodge(
        LodgeConfig(
            GlobalConfig(**TINY, music_frames=256, local_frames=64),
            LocalConfig(**TINY, num_frames=64),
        )
    )
    usual = inspect.signature(model.generate).parameters
    assert [usual[name].default for name in ("sampler", "steps")] == ["dpm", 20]
    assert Sampling("dpm", 20).calls(rows=7) == 20
    assert Sampling("ddim", 50).calls(rows=7) == 50


def test_l09_adan_at_1e_4_can_be_asked_for(solos, tmp_path):
    assert lodge.stage_config(lodge.check_lodge_tables({}, "here"), "local").optimizer == "adamw"
    asked = {"steps": 1, "warmup": 0, "optimizer": "adan", "lr": 1e-4, "ema": 0.0}
    settings = {"train": asked, "train_fine_tune": {"steps": 0}}
    trained = lodge.train_lodge(TABLES | settings, tmp_path, solos=solos)
    torch.manual_seed(0)
    start = lodge.LocalDenoiser(LocalConfig(**TABLES["local_stage"]))
    moved = trained.local_stage.trunk.embed.weight - start.trunk.embed.weight
    assert 0 < moved.abs().max() < 1e-3


def test_l11_the_hinge_is_content_with_a_margin():
    """Paper: the logarithm of eq. 9, whose gradient never ends."""
    for form, rest in (({}, 0.0), ({"form": "log"}, 0.2)):
        real, made = torch.tensor([1.5]), torch.tensor([-1.5]).requires_grad_()
        l_critic(real, made, **form).backward()
        assert made.grad.item() == pytest.approx(rest, abs=0.05)
    made = torch.tensor([3.0])
    assert l_genre(made).item() == -3.0 and l_genre(made, form="log").item() > 0


def test_l21_the_averaged_weights_are_danced_with(solos, tmp_path):
    """The released code averages too, and then dances with the last weights."""
    model = lodge.train_lodge(TABLES, tmp_path, solos=solos)
    for stage, part in (("global", model.global_stage), ("fine_tune", model.local_stage)):
        kept = load_file(tmp_path / stage / "checkpoint.safetensors")
        weight = part.trunk.embed.weight
        assert torch.equal(weight, kept["ema.trunk.embed.weight"])
        assert not torch.equal(weight, kept["model.trunk.embed.weight"])


def test_l22_diversity_is_right_where_the_reference_has_it():
    """The paper calls the highest the best; noise has a higher one than any dance."""
    dances = torch.randn(40, 32, generator=torch.Generator().manual_seed(0))
    for name in ("Div_k", "Div_g"):
        metric = next(metric for metric in METRICS if metric.name == name)
        assert metric.arrow == ALIKE
        assert metric.compare(3 * dances, dances) > 2 * metric.compare(dances, dances)


def test_l23_fine_tuning_sees_whole_locals(solos, tmp_path, monkeypatch):
    shapes, started_from = {}, {}

    class Trainer(lodge.Trainer):
        def run(self):
            shapes[self.out.name] = tuple(self.data.batch(0)[0].shape[1:])
            started_from[self.out.name] = self.model
            return self.model

    monkeypatch.setattr(lodge, "Trainer", Trainer)
    lodge.train_lodge(TABLES, tmp_path, solos=solos)
    assert shapes == {"global": (104, 139), "local": (64, 139), "fine_tune": (64, 139)}
    assert started_from["fine_tune"] is started_from["local"]
    paper = LocalConfig.paper()
    assert paper.num_frames == 256


def test_l24_guidance_is_off_in_the_last_tenth_of_ddpm():
    model = GlobalDenoiser(
        GlobalConfig(**TINY, music_frames=64, local_frames=32, num_steps=20, genres=GENRES)
    ).eval()
    seen = []
    model.register_forward_hook(lambda module, args, out: seen.append((int(args[1][0]), len(out))))
    how = Sampling(sampler="ddpm")
    sample_rows(model, torch.rand(1, 64, 35), style_tokens(model, 0, 1, how), how, GLOBALS)
    assert seen == [(t, 2 if t >= 2 else 1) for t in range(19, -1, -1)]  # with and without music
    seen.clear()
    how = Sampling(sampler="ddim", steps=10)
    sample_rows(model, torch.rand(1, 64, 35), style_tokens(model, 0, 1, how), how, GLOBALS)
    assert [rows for _, rows in seen] == [2] * 10
