"""Recorded steps are the steps of the trainer; without a GPU a replay computes anew."""

from dataclasses import replace
from types import SimpleNamespace

import pytest
import torch
from torch import nn

from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.gcd.model import GCD, GCDConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training import cuda_graph
from dancediff.training.config import TrainConfig, TrainingExtensions
from dancediff.training.cuda_graph import GraphTrainer, Recorded, fits_graphs, go_back, trainer_for
from dancediff.training.distributed import World
from dancediff.training.gcd import GCDObjective
from dancediff.training.objective import GroupObjective
from dancediff.training.optimizer import make_optimizer, set_learning_rate
from dancediff.training.trainer import Trainer

SIZES = {"d_model": 32, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "num_frames": 40}
CONFIG = TrainConfig(steps=12, warmup=6, decay=0.5, optimizer="muon", lr=2e-3)
GPU = pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")


class Replayed(GraphTrainer):
    """What stands in for a graph reads the same inputs and runs the same step."""

    def _record(self, drawn):
        fixed = drawn.clone()
        recorded = Recorded(None, fixed.tensors(), [], torch.zeros(1))

        def replay():
            with torch.enable_grad():
                recorded.names, recorded.losses = self._update(fixed, self.config.lr)

        recorded.graph = SimpleNamespace(replay=replay)
        return recorded


@pytest.fixture(autouse=True)
def no_processes(monkeypatch):
    monkeypatch.setattr(cuda_graph, "WORKERS", 0)


def sampler() -> WindowSampler:
    g = torch.Generator().manual_seed(0)
    takes = [
        DanceTake(f"{n}", torch.rand(n, 90, 151, generator=g), M=torch.rand(90, 35, generator=g))
        for n in (1, 2)
    ]
    return WindowSampler(takes, GroupCut(40), dancers_per_batch=4, seed=1)


def model_of(name: str) -> nn.Module:
    torch.manual_seed(0)
    if name == "TCDiffPP":
        return TCDiffPP(TCDiffPPConfig(**SIZES, fusion_hidden=32))
    return EDGE(EDGEConfig(**SIZES))


def trained(kind: type[Trainer], config: TrainConfig, name: str = "TCDiffPP", device: str = "cpu"):
    data = sampler()
    if name == "EDGE":
        data = WindowSampler([t for t in data.takes if t.num_dancers == 1], GroupCut(40), seed=1)
    trainer = kind(model_of(name).to(device), data, config)
    return trainer, [trainer.step(k) for k in range(config.steps)]


@pytest.mark.parametrize("optimizer", ["adamw", "muon"])
@pytest.mark.parametrize("share", [1.0, 0.4, 0.0])
def test_going_back_is_a_smaller_learning_rate(optimizer, share):
    def moved(lr: float, back: float) -> nn.Module:
        torch.manual_seed(0)
        net = nn.Linear(40, 40)
        steps = make_optimizer(net, replace(CONFIG, optimizer=optimizer, weight_decay=0.1))
        for k in range(3):
            net.zero_grad()
            net(torch.full((1, 40), float(k + 1))).square().sum().backward()
            before = [p.detach().clone() for p in net.parameters()]
            set_learning_rate(steps, lr)
            steps.step()
            with torch.no_grad():
                go_back(before, list(net.parameters()), back)
        return net

    plain, back = moved(0.01 * share, 1.0), moved(0.01, share)
    for a, b in zip(plain.parameters(), back.parameters(), strict=True):
        assert torch.allclose(a, b, atol=2e-4)


@pytest.mark.parametrize("name", ["TCDiffPP", "EDGE"])
@pytest.mark.parametrize("own_overlap", [0.0, 0.5])
def test_replayed_steps_are_the_trainers(name, own_overlap):
    extensions = replace(TrainingExtensions(), own_overlap=own_overlap, music_dropout=0.3)
    config = replace(CONFIG, extensions=extensions)
    plain, rows = trained(Trainer, config, name)
    replayed, late = trained(Replayed, config, name)
    assert replayed.recorded  # not all steps were eager
    for k in range(1, config.steps):
        assert late[k]["total"] == pytest.approx(rows[k - 1]["total"], rel=1e-3), k
        assert late[k]["lr"] == rows[k]["lr"]
    start = model_of(name)
    moved = zip(start.parameters(), plain.model.parameters(), strict=True)
    assert max((a - b).abs().mean().item() for a, b in moved) > 4e-3
    for a, b in zip(plain.model.parameters(), replayed.model.parameters(), strict=True):
        assert (a - b).abs().mean() < 2e-4
    for a, b in zip(plain.ema.model.parameters(), replayed.ema.model.parameters(), strict=True):
        assert (a - b).abs().mean() < 2e-4


def test_a_gradient_that_is_not_finite_ends_the_run_a_step_late():
    trainer = Replayed(model_of("TCDiffPP"), sampler(), CONFIG)
    trainer.step(0)
    with torch.no_grad():
        for weight in trainer.model.parameters():
            weight.fill_(torch.nan)
    trainer.step(1)  # shows the numbers of step 0
    with pytest.raises(RuntimeError, match="step 1 is not finite"):
        trainer.step(2)


class Poisoned(Replayed):
    """Its weights are no numbers from step 3 on, of which step 3 itself cannot know."""

    def step(self, step):
        if step == 3:
            with torch.no_grad():
                for weight in self.model.parameters():
                    weight.fill_(torch.nan)
        return super().step(step)


def test_a_checkpoint_is_never_written_over_with_what_is_not_finite(tmp_path):
    config = replace(CONFIG, save_every=2)
    with pytest.raises(RuntimeError, match="step 3 is not finite"):
        Poisoned(model_of("TCDiffPP"), sampler(), config, tmp_path).run()
    resumed = Replayed(model_of("TCDiffPP"), sampler(), config, tmp_path, resume=True)
    assert resumed.first == 2
    assert all(weight.isfinite().all() for weight in resumed.model.parameters())


class Own(TCDiffPP):
    """A network of somebody's own."""


def own_loss(c):
    return c.x_hat.square().mean()


def test_who_can_be_recorded():
    tcdiffpp, gcd = model_of("TCDiffPP"), GCD(GCDConfig(d_model=16, num_layers=1, ff_dim=16))
    group = GroupObjective(tcdiffpp, CONFIG)
    assert fits_graphs(group, CONFIG, None) and fits_graphs(group, CONFIG, World())
    assert not fits_graphs(group, CONFIG, World(rank=0, size=2))
    assert not fits_graphs(group, replace(CONFIG, accumulate=2), None)
    assert not fits_graphs(group, replace(CONFIG, optimizer="adan"), None)
    own_loss = replace(TrainingExtensions(), own_loss="test_cuda_graph:own_loss")
    assert not fits_graphs(group, replace(CONFIG, extensions=own_loss), None)
    assert not fits_graphs(GroupObjective(Own(tcdiffpp.config), CONFIG), CONFIG, None)
    weights = GCDObjective.weights()
    assert not fits_graphs(GCDObjective(gcd, replace(CONFIG, weights=weights)), CONFIG, None)
    assert trainer_for(group, CONFIG, None) is Trainer  # no GPU
    with pytest.raises(ValueError, match=r"accumulate=1 \(here 2\)"):
        GraphTrainer(tcdiffpp, sampler(), replace(CONFIG, accumulate=2))


@GPU
@pytest.mark.parametrize("name", ["TCDiffPP", "EDGE"])
def test_a_graph_on_a_gpu_makes_the_trainers_steps(name):
    config = replace(CONFIG, steps=16, weight_decay=0.0)
    _, rows = trained(Trainer, config, name, "cuda")
    graphs, late = trained(GraphTrainer, config, name, "cuda")
    assert graphs.recorded
    for k in range(1, config.steps):
        assert late[k]["total"] == pytest.approx(rows[k - 1]["total"], rel=0.02), k
