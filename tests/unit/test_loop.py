import csv
from dataclasses import dataclass
from types import SimpleNamespace

import pytest
import torch
from torch import nn

from dancediff.diffusion.schedule import cosine_abar
from dancediff.motion.representation import Normalizer
from dancediff.papers.tcdiffpp.fusion_projection import FusionProjection
from dancediff.training import loop, loss_log
from dancediff.training.distributed import World
from dancediff.training.loop import (
    TrainConfig,
    level_weights,
    losses_of,
    make_optimizer,
    schedule_step,
    train,
    train_step,
)
from dancediff.training.loss_log import LossLog


@dataclass
class ToyConfig:
    num_steps: int = 1000
    cond_drop: float = 0.25


class Toy(nn.Module):
    """A denoiser of one weight and a dropout, so that a step takes milliseconds."""

    def __init__(self):
        super().__init__()
        self.gain, self.dropout = nn.Parameter(torch.tensor(0.5)), nn.Dropout(0.5)
        self.config = ToyConfig()
        one = torch.ones(151)
        self.normalizer = Normalizer(-one, one)
        self.music_normalizer = SimpleNamespace(normalize=lambda M: M)
        self.register_buffer("abar", cosine_abar(1000), persistent=False)
        self.heard = []

    def forward(self, x_t, t, M, S, *, keep):
        self.heard.append((t, keep))
        x_raw = self.gain * self.dropout(x_t)
        return x_raw, x_raw


class Data:
    def __init__(self, spoil_at=None, b=2):
        self.spoil_at, self.b, self.asked = spoil_at, b, []

    def batch(self, step):
        self.asked.append(step)
        g = torch.Generator().manual_seed(step)
        x = torch.rand(self.b, 2, 5, 151, generator=g)
        if step == self.spoil_at:
            x[0, 0, 0, 0] = float("nan")
        return x, torch.zeros(self.b, 5, 35), torch.arange(2).expand(self.b, 2)


def rows(folder):
    return list(csv.DictReader((folder / "losses.csv").read_text().splitlines()))


def test_log_has_every_step_once_after_a_stop(tmp_path):
    """Steps run after the last checkpoint are run again; they must not be logged twice."""
    config = TrainConfig(steps=8, warmup=0, save_every=3)

    class Stop(Data):
        def batch(self, step):
            if step == 5:
                raise KeyboardInterrupt
            return super().batch(step)

    with pytest.raises(KeyboardInterrupt):
        train(Toy(), Stop(), config, tmp_path)
    assert [int(row["step"]) for row in rows(tmp_path)] == [0, 1, 2, 3, 4]
    data = Data()
    train(Toy(), data, config, tmp_path, resume=True)
    assert data.asked == [3, 4, 5, 6, 7]
    assert [int(row["step"]) for row in rows(tmp_path)] == list(range(8))
    seconds = [float(row["seconds"]) for row in rows(tmp_path)]
    assert seconds == sorted(seconds)


def test_a_new_run_replaces_an_old_log(tmp_path):
    for _ in range(2):
        train(Toy(), Data(), TrainConfig(steps=3), tmp_path)
    assert len(rows(tmp_path)) == 3


def test_what_a_killed_run_left_is_removed(tmp_path):
    (tmp_path / ".part.99.checkpoint.safetensors").write_bytes(b"half a file")
    train(Toy(), Data(), TrainConfig(steps=1), tmp_path)
    assert not list(tmp_path.glob(".*"))


def test_log_survives_a_half_written_line(tmp_path):
    (tmp_path / "losses.csv").write_text("step,seconds,total\n0,1.5,9\n1,2.5,8\n2,3.5,7\n3,")
    with LossLog(tmp_path / "losses.csv", first=2) as log:
        assert log.seconds >= 2.5
        log.write(2, {"total": 6.0})
    assert [row["total"] for row in rows(tmp_path)] == ["9", "8", "6"]


def test_finished_run_is_not_run_again(tmp_path):
    config = TrainConfig(steps=3)
    first = train(Toy(), Data(), config, tmp_path)
    data = Data()
    again = train(Toy(), data, config, tmp_path, resume=True)
    assert data.asked == [] and torch.equal(first.gain, again.gain)


def test_a_run_can_be_prolonged(tmp_path):
    train(Toy(), Data(), TrainConfig(steps=3), tmp_path)
    data = Data()
    train(Toy(), data, TrainConfig(steps=5), tmp_path, resume=True)
    assert data.asked == [3, 4]


def test_time_budget_ends_the_run_and_keeps_it(tmp_path, monkeypatch):
    clock = iter(range(0, 10_000, 6))  # every look at the clock takes six seconds
    monkeypatch.setattr(loss_log.time, "monotonic", lambda: float(next(clock)))
    data = Data()
    train(Toy(), data, TrainConfig(steps=1000, max_minutes=1), tmp_path)
    assert 2 <= len(data.asked) < 12
    assert len(rows(tmp_path)) == len(data.asked)
    more = Data()
    train(Toy(), more, TrainConfig(steps=1000, max_minutes=1), tmp_path, resume=True)
    assert len(more.asked) <= 1  # the time of the first run counts


def test_a_time_budget_is_for_one_process(tmp_path):
    config = TrainConfig(steps=10, max_minutes=1)
    with pytest.raises(ValueError, match=r"max_minutes=1 is for one process: each of 2"):
        train(Toy(), Data(), config, tmp_path / "run", world=World(rank=1, size=2))
    assert not (tmp_path / "run").exists()


def test_clock_only_ever_hurries_the_schedule():
    config = TrainConfig(steps=100, max_minutes=10)
    assert schedule_step(80, 60.0, config) == 80
    assert schedule_step(0, 600.0, config) == 100
    assert schedule_step(80, 1e9, TrainConfig(steps=100)) == 80


def test_step_is_repeatable_and_leaves_global_randomness_alone():
    config, results = TrainConfig(warmup=0), []
    for seed in (1, 2):
        torch.manual_seed(seed)
        state = torch.get_rng_state()
        model = Toy()
        optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3)
        terms = train_step(model, model, optimizer, Data(), 4, config)
        assert torch.equal(torch.get_rng_state(), state)
        results.append((terms["total"], model.gain.item()))
    assert results[0] == results[1]


def test_noise_strength_and_dropped_music_are_drawn_per_group():
    model, config = Toy(), TrainConfig(warmup=0)
    optimizer = torch.optim.AdamW(model.parameters(), lr=1e-3)
    for step in range(8):
        train_step(model, model, optimizer, Data(b=64), step, config)
    t, keep = (torch.cat(part) for part in zip(*model.heard, strict=True))
    assert t.shape == (512,) and 0 <= t.min() < 20 and 980 < t.max() <= 999
    assert abs(t.float().mean() - 499.5) < 3 * 289 / 512**0.5  # uniform: mean 499.5, std 289
    assert abs((~keep).float().mean() - 0.25) < 3 * 0.433 / 512**0.5


def test_fusion_projection_takes_smaller_steps():
    """Adam's first step is the learning rate itself, whatever the gradient."""
    torch.manual_seed(0)
    model = nn.Sequential(nn.Linear(8, 8), FusionProjection(2, 4, 6))
    config = TrainConfig(lr=1e-2, fusion_lr=0.1, weight_decay=0.0)
    optimizer = make_optimizer(model, config)
    before = [weight.detach().clone() for weight in model.parameters()]
    for group in optimizer.param_groups:
        group["lr"] *= group["share"]
    model[1](model[0](torch.randn(50, 2, 3, 8))[..., :4]).square().sum().backward()
    optimizer.step()
    moved = [(a - b).abs().max().item() for a, b in zip(model.parameters(), before, strict=True)]
    assert moved[0] == pytest.approx(1e-2, rel=1e-3)
    assert moved[2] == pytest.approx(1e-3, rel=1e-3)
    assert len(moved) == sum(len(group["params"]) for group in optimizer.param_groups)


def test_gradient_is_clipped():
    model, config = Toy(), TrainConfig(warmup=0, clip=1e-3)
    optimizer = torch.optim.SGD(model.parameters(), lr=1.0)
    before = model.gain.item()
    train_step(model, model, optimizer, Data(), 0, config, lr=1.0)
    assert abs(model.gain.item() - before) == pytest.approx(1e-3, rel=1e-2)


def test_broken_numbers_stop_the_run_before_they_spread(tmp_path):
    model = Toy()
    with pytest.raises(RuntimeError, match="gradient of step 4 is not finite"):
        train(model, Data(spoil_at=4), TrainConfig(steps=9, save_every=2), tmp_path)
    assert model.gain.isfinite()
    data = Data()
    train(Toy(), data, TrainConfig(steps=6, save_every=2), tmp_path, resume=True)
    assert data.asked == [4, 5]


@pytest.mark.parametrize(
    "wrong",
    [
        {"precision": "bf61"},
        {"steps": 0},
        {"lr": -1.0},
        {"decay": 1.5},
        {"ema": 1.0},
        {"clip": 0.0},
        {"save_every": 0},
        {"max_minutes": 0.0},
    ],
)
def test_wrong_settings_are_named(wrong):
    ((name, value),) = wrong.items()
    with pytest.raises(ValueError, match=f"{name}={value!r}".replace("'", ".")):
        TrainConfig(**wrong)


def test_accumulation_is_the_mean_of_its_batches(tmp_path):
    """Two batches a step have the mean gradient, and are drawn with numbers of their own."""
    gradients = []
    for numbers in ([6], [7], [6, 7]):
        model = Toy()
        optimizer = torch.optim.SGD(model.parameters(), lr=0.0)
        config = TrainConfig(warmup=0, clip=1e9, accumulate=len(numbers))
        data = Data()
        train_step(model, model, optimizer, data, numbers[0] // len(numbers), config, lr=0.0)
        assert data.asked == numbers
        gradients.append(model.gain.grad.item())
    assert gradients[2] == pytest.approx((gradients[0] + gradients[1]) / 2, rel=1e-5)


def test_previews_see_the_averaged_model_at_their_steps(tmp_path):
    seen = []
    config = TrainConfig(steps=7, warmup=0, preview_every=3)
    model = Toy()
    averaged = train(
        model, Data(), config, tmp_path, preview=lambda m, step: seen.append((step, m.gain.item()))
    )
    assert [step for step, _ in seen] == [3, 6]
    assert seen[0][1] != model.gain.item() and averaged is not model


def test_heavy_levels_are_drawn_more_often_and_count_as_much_as_they_should():
    """The share of a level in all losses is its weight, however often it is drawn."""
    model, weights = Toy(), level_weights(1.001 - cosine_abar().float(), 1.0)
    counted = []

    def note(*_, weight=None, **__):
        counted.append(weight)
        return {"total": weight.sum()}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(loop, "tcdiffpp_losses", note)
        for number in range(200):
            losses_of(model, model, Data(b=64).batch(number), number, TrainConfig(), weights)
    t, counted = torch.cat([t for t, _ in model.heard]), torch.cat(counted)
    low, odds = t < 100, weights.sqrt() / weights.sqrt().sum()
    assert low.float().mean().item() == pytest.approx(odds[:100].sum().item(), abs=0.02)
    assert low.float().mean() > 0.2
    share = (counted * low).sum() / counted.sum()
    assert share.item() == pytest.approx((weights[:100].sum() / weights.sum()).item(), abs=0.03)
    assert counted.mean().item() == pytest.approx(weights.mean().item(), rel=0.05)


def test_level_power_needs_preconditioning(tmp_path):
    with pytest.raises(ValueError, match=r"level_power=0.5 needs a model with precondition=True"):
        train(Toy(), Data(), TrainConfig(steps=1, level_power=0.5), tmp_path)


def test_level_power_goes_from_all_alike_to_all_missed_alike():
    error = torch.tensor([1e-4, 1e-2, 5e-2])
    assert torch.equal(level_weights(error, 0.0), torch.ones(3))
    missed = level_weights(error, 1.0) * error
    torch.testing.assert_close(missed, error.mean().expand(3))
    with pytest.raises(ValueError, match=r"level_power=1\.5"):
        TrainConfig(level_power=1.5)
