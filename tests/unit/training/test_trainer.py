import signal
from types import SimpleNamespace

import pytest
import torch
from torch import nn

from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.level_weights import level_weights
from dancediff.nn.decoder import FusionProjection
from dancediff.training import objective
from dancediff.training.checkpoint import load_average, read_facts
from dancediff.training.config import TrainConfig, TrainingExtensions
from dancediff.training.evaluator import BATCHES, Evaluator
from dancediff.training.logger import Logger
from dancediff.training.objective import GroupObjective
from dancediff.training.optimizer import make_optimizer, set_learning_rate
from dancediff.training.trainer import Trainer, name_of
from toy_training import Data, Toy, ToyConfig, rows, train


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
        train(Toy(), Data(), TrainConfig(steps=3), tmp_path, overwrite=True)
    assert len(rows(tmp_path)) == 3


def test_a_new_run_forgets_what_the_old_one_evaluated_and_showed(tmp_path):
    """Rows of metrics.csv and previews of the old one stood between those of the new one."""
    config = TrainConfig(steps=3, evaluate_every=1)
    train(Toy(), Data(), config, tmp_path, evaluator=Evaluator(Data(), config))
    for folder in ("previews", "best"):
        (tmp_path / folder).mkdir()
    old = [
        tmp_path / name
        for name in ("metrics.csv", "previews/step_000002.png", "best/model.safetensors")
    ]
    for path in old:
        path.write_text("step\n2\n")
    old.append(tmp_path / "best.safetensors")
    with pytest.raises(ValueError, match="holds a training"):
        train(Toy(), Data(), TrainConfig(steps=4), tmp_path)
    train(Toy(), Data(), TrainConfig(steps=4), tmp_path, resume=True)
    assert all(path.exists() for path in old)
    train(Toy(), Data(), TrainConfig(steps=4), tmp_path, overwrite=True)
    assert not any(path.exists() for path in old)


def test_checkpoints_are_due_from_time_to_time_and_at_the_end():
    trainer = Trainer(Toy(), Data(), TrainConfig(steps=8, save_every=3))
    assert [step for step in range(1, 9) if trainer.is_due(step)] == [3, 6, 8]


def test_what_a_killed_run_left_is_removed(tmp_path):
    (tmp_path / ".part.99.checkpoint.safetensors").write_bytes(b"half a file")
    train(Toy(), Data(), TrainConfig(steps=1), tmp_path)
    assert not list(tmp_path.glob(".*"))


def test_log_survives_a_half_written_line(tmp_path):
    (tmp_path / "losses.csv").write_text("step,seconds,total\n0,1.5,9\n1,2.5,8\n2,3.5,7\n3,")
    with Logger(tmp_path / "losses.csv", first=2) as log:
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


def test_step_is_repeatable_and_leaves_global_randomness_alone():
    config, results = TrainConfig(warmup=0), []
    for seed in (1, 2):
        torch.manual_seed(seed)
        state = torch.get_rng_state()
        model = Toy()
        terms = Trainer(model, Data(), config).step(4)
        assert torch.equal(torch.get_rng_state(), state)
        results.append((terms["total"], model.gain.item()))
    assert results[0] == results[1]


def test_noise_strength_and_dropped_music_are_drawn_per_group():
    model, config = Toy(), TrainConfig(warmup=0)
    trainer = Trainer(model, Data(b=64), config)
    for step in range(8):
        trainer.step(step)
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


def test_every_group_gets_its_share_of_the_learning_rate():
    model = nn.Sequential(nn.Linear(8, 8), FusionProjection(2, 4, 6))
    optimizer = make_optimizer(model, TrainConfig(fusion_lr=0.1))
    set_learning_rate(optimizer, 0.5)
    assert [group["lr"] for group in optimizer.param_groups] == [0.5, 0.05]


def test_a_step_forgets_the_gradients_of_the_one_before():
    config, gradients = TrainConfig(warmup=0, lr=1e-12, clip=1e9), []
    for first in (0, 1):
        model = Toy()
        trainer = Trainer(model, Data(), config)
        for step in range(first, 2):
            trainer.step(step)
        gradients.append(model.gain.grad.item())
    assert gradients[0] == pytest.approx(gradients[1], rel=1e-5)


def test_the_average_follows_every_step():
    model = Toy()
    trainer = Trainer(model, Data(), TrainConfig(warmup=0, ema=0.0))
    for step in range(2):
        trainer.step(step)
        assert trainer.ema.model.gain.item() == model.gain.item() != 0.5


def test_the_log_has_what_a_checkpoint_has(tmp_path):
    """Or a kill would leave the log of the training that was here before."""
    train(Toy(), Data(), TrainConfig(steps=3), tmp_path)
    config = TrainConfig(steps=5, save_every=2)
    trainer = Trainer(Toy(), Data(), config, tmp_path, overwrite=True)
    save, logged = trainer.checkpointer.save, []

    def saving(step, extra):
        logged.append((step, len(rows(tmp_path))))
        save(step, extra)

    trainer.checkpointer.save = saving
    trainer.run()
    assert logged == [(2, 2), (4, 4), (5, 5)]


def test_gradient_is_clipped():
    model, config = Toy(), TrainConfig(warmup=0, clip=1e-3, lr=1.0)
    before = model.gain.item()
    trainer = Trainer(model, Data(), config)
    trainer.optimizer = torch.optim.SGD(model.parameters(), lr=1.0)
    assert trainer.step(0)["gradient"] > 1e-3  # the log has it as it was
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
        {"clip": -1.0},
        {"save_every": 0},
        {"warmup": -1},
        {"preview_every": -1},
        {"evaluate_every": -1},
        {"weight_decay": -0.1},
        {"seed": -1},
        {"seed": 10**30},
        {"patience": -1},
        {"lr": float("nan")},
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
        config = TrainConfig(warmup=0, clip=1e9, accumulate=len(numbers))
        data = Data()
        Trainer(model, data, config).step(numbers[0] // len(numbers))
        assert data.asked == numbers
        gradients.append(model.gain.grad.item())
    assert gradients[2] == pytest.approx((gradients[0] + gradients[1]) / 2, rel=1e-5)


def test_previews_see_the_averaged_model_at_their_steps(tmp_path):
    seen = []
    config = TrainConfig(steps=7, warmup=0, preview_every=3)
    model = Toy()
    evaluator = Evaluator(None, config, lambda m, step: seen.append((step, m)))
    averaged = train(model, Data(), config, tmp_path, evaluator=evaluator)
    assert [step for step, _ in seen] == [3, 6]
    assert all(shown is averaged for _, shown in seen) and averaged is not model


def test_heavy_levels_are_drawn_more_often_and_count_as_much_as_they_should():
    """The share of a level in all losses is its weight, however often it is drawn."""
    model, weights = Toy(), level_weights(1.001 - cosine_abar().float(), 1.0)
    counted = []

    def note(*_, row_weights=None, **__):
        counted.append(row_weights)
        return {"total": row_weights.sum()}

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(objective, "extended_losses", note)
        patch.setattr(GroupObjective, "level_weights", weights)
        wanted = GroupObjective(model, TrainConfig())
        for number in range(200):
            wanted.losses(model, Data(b=64).batch(number), number)
    t, counted = torch.cat([t for t, _ in model.heard]), torch.cat(counted)
    low, odds = t < 100, weights.sqrt() / weights.sqrt().sum()
    assert low.float().mean().item() == pytest.approx(odds[:100].sum().item(), abs=0.02)
    assert low.float().mean() > 0.2
    share = (counted * low).sum() / counted.sum()
    assert share.item() == pytest.approx((weights[:100].sum() / weights.sum()).item(), abs=0.03)
    assert counted.mean().item() == pytest.approx(weights.mean().item(), rel=0.05)


def test_level_weights_need_preconditioning(tmp_path):
    weighted = TrainingExtensions(level_weights=0.5)
    with pytest.raises(ValueError, match=r"level_weights=0.5 needs a model with preconditioning"):
        train(Toy(), Data(), TrainConfig(steps=1, extensions=weighted), tmp_path)


def test_level_weights_go_from_all_alike_to_all_missed_alike():
    error = torch.tensor([1e-4, 1e-2, 5e-2])
    assert torch.equal(level_weights(error, 0.0), torch.ones(3))
    missed = level_weights(error, 1.0) * error
    torch.testing.assert_close(missed, error.mean().expand(3))
    with pytest.raises(ValueError, match=r"level_weights=1\.5"):
        TrainingExtensions(level_weights=1.5)


def test_a_training_is_not_overwritten_by_accident(tmp_path):
    train(Toy(), Data(), TrainConfig(steps=3), tmp_path)
    with pytest.raises(ValueError, match=r"holds a training; go on with it \(resume\)"):
        train(Toy(), Data(), TrainConfig(steps=3), tmp_path)
    with pytest.raises(ValueError, match="exclude each other"):
        train(Toy(), Data(), TrainConfig(steps=3), tmp_path, resume=True, overwrite=True)
    assert len(rows(tmp_path)) == 3


def test_going_on_with_other_data_or_settings_is_said(tmp_path):
    train(Toy(), Data(), TrainConfig(steps=2), tmp_path, data_name="salsa")
    with pytest.warns(UserWarning, match="in a training on other data"):
        train(Toy(), Data(), TrainConfig(steps=3), tmp_path, resume=True, data_name="waltz")
    with pytest.warns(UserWarning, match=r"with other settings: lr=0\.001, here 0\.01$"):
        train(
            Toy(), Data(), TrainConfig(steps=4, lr=1e-2), tmp_path, resume=True, data_name="waltz"
        )


def test_another_model_or_optimizer_is_refused_in_one_line(tmp_path):
    train(Toy(), Data(), TrainConfig(steps=2), tmp_path)
    other = Toy()
    other.config = ToyConfig(cond_drop=0.5)
    with pytest.raises(ValueError, match=r"another model \(cond_drop=0\.25, here 0\.5\)"):
        train(other, Data(), TrainConfig(steps=2), tmp_path, resume=True)
    with pytest.raises(ValueError, match=r"another optimizer \(optimizer=adamw, here muon\)"):
        train(Toy(), Data(), TrainConfig(steps=2, optimizer="muon"), tmp_path, resume=True)


@pytest.mark.parametrize(("key", "value"), [("masked_music", ("chroma",)), ("metre_unit", True)])
def test_scales_that_would_be_fitted_otherwise_are_refused(tmp_path, key, value):
    """They are in the checkpoint; the old ones stayed, and the log said the new ones."""
    train(Toy(), Data(), TrainConfig(steps=2), tmp_path)
    config = TrainConfig(steps=3, extensions=TrainingExtensions(**{key: value}))
    with pytest.raises(ValueError, match=rf"another scale of motion or music \({key}=.*, here "):
        train(Toy(), Data(), config, tmp_path, resume=True)


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="signals of Unix")
def test_signals_are_answered_between_steps(tmp_path):
    """SIGUSR1 writes a checkpoint and goes on; SIGTERM writes one and ends the process."""
    handlers = [signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGUSR1)]

    class Told(Data):
        def batch(self, number):
            if number in (2, 4):
                signal.raise_signal(signal.SIGUSR1 if number == 2 else signal.SIGTERM)
            if number == 3:
                assert read_facts(tmp_path / "checkpoint.safetensors")["step"] == 3
            return super().batch(number)

    data = Told()
    with pytest.raises(SystemExit) as stop:
        train(Toy(), data, TrainConfig(steps=9), tmp_path)
    assert stop.value.code == 143 and data.asked == [0, 1, 2, 3, 4]
    assert [signal.getsignal(n) for n in (signal.SIGTERM, signal.SIGUSR1)] == handlers
    data = Data()
    stopped = train(Toy(), data, TrainConfig(steps=9), tmp_path, resume=True)
    assert data.asked == [5, 6, 7, 8] and len(rows(tmp_path)) == 9
    assert torch.equal(stopped.gain, train(Toy(), Data(), TrainConfig(steps=9)).gain)


def test_validation_on_fixed_windows_keeps_the_best(tmp_path):
    """The loss of the averaged model; a worse one later does not replace the best."""
    config = TrainConfig(steps=6, warmup=0, lr=0.05, evaluate_every=2)
    held_out = Data()
    evaluator = Evaluator(held_out, config)
    averaged = train(Toy(), Data(), config, tmp_path, evaluator=evaluator)
    assert held_out.asked == [*range(BATCHES)] * 3
    losses = [row["validation"] for row in rows(tmp_path)]
    assert losses[0] == losses[2] == "" and float(losses[5]) > 0
    again = evaluator.validation_loss(averaged, GroupObjective(averaged, config))
    assert float(losses[5]) == pytest.approx(again, rel=1e-5)
    best = min(float(loss) for loss in losses if loss)
    facts = read_facts(tmp_path / "best.safetensors")
    assert facts["validation"] == pytest.approx(best, rel=1e-5)
    evaluator.keep_best(Toy(), best + 1, 8, tmp_path)
    assert read_facts(tmp_path / "best.safetensors") == facts
    evaluator.keep_best(Toy(), best - 0.1, 8, tmp_path)
    assert load_average(tmp_path / "best.safetensors", averaged).gain == 0.5


def test_validation_does_not_change_the_training(tmp_path):
    plain = train(Toy(), Data(), TrainConfig(steps=5))
    config = TrainConfig(steps=5, evaluate_every=1)
    assert torch.equal(
        train(Toy(), Data(), config, evaluator=Evaluator(Data(), config)).gain, plain.gain
    )


class Worse(Evaluator):
    """Says losses that were noted before."""

    losses, told = (3.0, 1.0, 2.0, 0.9, 1.5, 1.5, 0.95, 0.1, 0.1), 0

    def validation_loss(self, model, objective):
        self.told += 1
        return self.losses[self.told - 1]


def early(folder, patience, *, resume=False, told=0, **options):
    config = TrainConfig(steps=18, warmup=0, evaluate_every=2, patience=patience, **options)
    data, evaluator = Data(), Worse(Data(), config)
    evaluator.told = told
    trainer = Trainer(Toy(), data, config, folder, evaluator=evaluator, resume=resume)
    trainer.run()
    return data.asked, trainer


def test_training_ends_when_nothing_gets_better(tmp_path, capsys):
    """The fourth evaluation is the best, and three more are not."""
    asked, _ = early(tmp_path, 3)
    assert asked == list(range(14)) and len(rows(tmp_path)) == 14
    assert read_facts(tmp_path / "checkpoint.safetensors")["step"] == 14
    assert read_facts(tmp_path / "best.safetensors")["step"] == 8
    said = "ends after 14 of 18 steps: none of the last 3 evaluations was better than that after 8"
    assert said in capsys.readouterr().err
    for patience in (0, 4):  # patience is off by default; four are never reached
        assert len(early(None, patience)[0]) == 18


def test_a_training_that_goes_on_knows_how_long_nothing_got_better(tmp_path):
    """Killed between two evaluations, or ended: it counts on from the best."""
    config = TrainConfig(steps=18, warmup=0, evaluate_every=2, patience=3, save_every=1)

    class Killed(Data):
        def batch(self, number):
            if number == 11:
                raise KeyboardInterrupt
            return super().batch(number)

    with pytest.raises(KeyboardInterrupt):
        train(Toy(), Killed(), config, tmp_path, evaluator=Worse(Data(), config))
    asked, _ = early(tmp_path, 3, resume=True, told=5, save_every=1)
    assert asked == [11, 12, 13]
    assert early(tmp_path, 3, resume=True)[0] == []  # ended, and stays so
    assert early(tmp_path, 5, resume=True, told=7)[0] == [14, 15, 16, 17]


def test_patience_counts_from_where_a_run_goes_on_that_evaluated_nothing(tmp_path):
    """It ended before its first evaluation, as if nothing had got better since step 0."""
    train(Toy(), Data(), TrainConfig(steps=10, warmup=0), tmp_path)
    asked, trainer = early(tmp_path, 3, resume=True)
    assert asked == list(range(10, 18)) and trainer.evaluator.best_step == 18


def test_a_loss_that_is_no_number_is_never_the_best(tmp_path):
    evaluator = Evaluator(Data(), TrainConfig(evaluate_every=1, patience=2))
    evaluator.keep_best(Toy(), float("nan"), 1, tmp_path)
    assert not (tmp_path / "best.safetensors").exists() and evaluator.is_enough(2)
    evaluator.keep_best(Toy(), 1.0, 3, tmp_path)
    assert not evaluator.is_enough(4) and evaluator.is_enough(5)


def test_patience_needs_evaluations():
    with pytest.raises(ValueError, match="patience=3 counts evaluations; set evaluate_every"):
        TrainConfig(patience=3)


def test_the_log_has_the_learning_rate(tmp_path):
    train(Toy(), Data(), TrainConfig(steps=4, warmup=2, lr=0.1, decay=0.0), tmp_path)
    assert [float(row["lr"]) for row in rows(tmp_path)] == [0.05, 0.1, 0.1, 0.1]
    assert all(float(row["gradient"]) > 0 for row in rows(tmp_path))


def test_an_old_log_gets_new_columns(tmp_path):
    (tmp_path / "losses.csv").write_text("step,seconds,total\n0,1.5,9\n1,2.5,8\n")
    with Logger(tmp_path / "losses.csv", first=2) as log:
        log.write(2, {"total": 6.0, "lr": 0.1})
    assert [row["lr"] for row in rows(tmp_path)] == ["", "", "0.1"]


def test_a_data_name_changes_with_the_frames():
    def take(x):
        return SimpleNamespace(name="a", x=x)

    x = torch.zeros(2, 90, 151)
    assert name_of([take(x)], {}) == name_of([take(x.clone())], {})
    assert name_of([take(x)], {}) != name_of([take(x + 1)], {})
    assert name_of([take(x)], {}) != name_of([take(x)], {"mirror": 0.5})


@pytest.mark.parametrize("key", ["workers", "held_out", "folder"])
def test_a_data_name_stays_where_no_window_changes(key):
    assert name_of([], {"mirror": 0.5, key: 1}) == name_of([], {"mirror": 0.5, key: 2})
