"""Decisions about how Lodge is trained and sampled, one test each.

The numbers are those of the lines of docs/differences.md on Lodge.
"""

import pytest
import torch
from safetensors.torch import load_file

from dancediff.data.take import DanceTake
from dancediff.generation.request import default_of
from dancediff.metrics.rows import ALIKE, METRICS
from dancediff.motion.representation import with_hands
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.losses import l_critic, l_genre
from dancediff.papers.lodge.model import Lodge
from dancediff.papers.lodge.parallel import GLOBALS, ParallelSampler
from dancediff.training import lodge
from dancediff.training.adan import Adan
from dancediff.training.trainer import Trainer
from tiny_lodge import GLOBAL, LOCAL, ask, tiny_lodge

GENRES = ("hiphop", "salsa")
TABLES = {
    "data": {"windows_per_batch": 2},
    "global_stage": GLOBAL,
    "local_stage": LOCAL | {"genres": GENRES},
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
    assert [default_of("lodge", name) for name in ("sampler", "steps")] == ["dpm", 20]
    assert [default_of("lodge", name, "paper") for name in ("sampler", "steps")] == ["ddim", 50]
    model, calls = tiny_lodge(()), {"global_stage": 0, "local_stage": 0}

    def count(name):
        def hook(module, args, out):
            calls[name] += 1

        return hook

    for name in calls:
        getattr(model, name).register_forward_hook(count(name))
    M = torch.rand(256, 35, generator=torch.Generator().manual_seed(0))
    ParallelSampler(model.global_stage, model.local_stage, ask(steps=7)).dance(M, 200)
    assert calls == {"global_stage": 7, "local_stage": 7}


def test_l09_adan_at_1e_4_can_be_asked_for(solos, tmp_path, monkeypatch):
    steps, plain = [], Adan.step
    monkeypatch.setattr(Adan, "step", lambda self, *a: steps.append(self) or plain(self, *a))
    assert lodge.stage_config(lodge.check_lodge_tables({}, "here"), "local").optimizer == "adamw"
    asked = {"steps": 1, "warmup": 0, "optimizer": "adan", "lr": 1e-4, "ema": 0.0}
    settings = {"train": asked, "train_fine_tune": {"steps": 0}}
    trained = lodge.train_lodge(TABLES | settings, tmp_path, solos=solos)
    torch.manual_seed(0)
    start = lodge.build(Lodge, lodge.sizes_of(TABLES)).local_stage
    moved = trained.local_stage.decoder.embed.weight - start.decoder.embed.weight
    assert 0 < moved.abs().max() < 1e-3
    assert steps and all(one.param_groups[0]["lr"] <= 1e-4 for one in steps)


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
        weight = part.decoder.embed.weight
        assert torch.equal(weight, kept["ema.decoder.embed.weight"])
        assert not torch.equal(weight, kept["model.decoder.embed.weight"])


def test_l22_diversity_is_right_where_the_reference_has_it():
    """The paper calls the highest the best; noise has a higher one than any dance."""
    dances = torch.randn(40, 32, generator=torch.Generator().manual_seed(0))
    for name in ("Div_k", "Div_g"):
        metric = next(metric for metric in METRICS if metric.name == name)
        assert metric.arrow == ALIKE
        assert metric.compare(3 * dances, dances) > 2 * metric.compare(dances, dances)


def test_l23_fine_tuning_sees_whole_locals(solos, tmp_path, monkeypatch):
    shapes, started_from = {}, {}

    class Watched(Trainer):
        def run(self):
            shapes[self.out.name] = tuple(self.data.batch(0)[0].shape[1:])
            started_from[self.out.name] = self.model
            return self.model

    monkeypatch.setattr(lodge, "trainer_for", lambda *training: Watched)
    lodge.train_lodge(TABLES, tmp_path, solos=solos)
    assert shapes == {"global": (104, 139), "local": (64, 139), "fine_tune": (64, 139)}
    assert started_from["fine_tune"] is started_from["local"]
    assert LocalConfig().num_frames == 256


def test_l24_guidance_is_off_in_the_last_tenth_of_ddpm():
    model = tiny_lodge((), first={"num_steps": 20}, second={"num_steps": 20})
    stage, seen = model.global_stage, []
    stage.register_forward_hook(lambda module, args, out: seen.append((int(args[1][0]), len(out))))

    def run(**options):
        seen.clear()
        sampler = ParallelSampler(stage, model.local_stage, ask(**options))
        sampler.sample(stage, GLOBALS, torch.rand(1, 256, 35), 0)

    run(sampler="ddpm")
    assert seen == [(t, 2 if t >= 2 else 1) for t in range(19, -1, -1)]  # with and without music
    run(sampler="ddim", steps=10)
    assert [rows for _, rows in seen] == [2] * 10
