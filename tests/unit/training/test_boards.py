"""Numbers of a training on boards of others; each is tested where it is installed."""

import pytest

from dancediff.training import boards
from dancediff.training.config import TrainConfig
from dancediff.training.logger import Logger
from dancediff.training.trainer import Trainer
from toy_training import Data, Toy, rows


class Noted:
    """A board that remembers."""

    def __init__(self, folder, first, facts):
        self.begun, self.seen, self.closed = (folder, first, facts), [], False
        boards.made = self

    def add(self, step, values):
        self.seen.append((step, values))

    def close(self):
        self.closed = True


@pytest.fixture
def noted(monkeypatch):
    monkeypatch.setitem(boards.BOARDS, "tensorboard", Noted)
    monkeypatch.setattr(boards, "_installed", lambda name: name == "tensorboard")
    monkeypatch.setattr(boards, "made", None, raising=False)


def test_a_board_sees_every_number_of_the_csv(tmp_path, noted):
    config = TrainConfig(steps=3)
    Trainer(Toy(), Data(), config, tmp_path, log="csv,tensorboard").run()
    folder, first, facts = boards.made.begun
    assert (folder, first, facts["train"]["steps"]) == (tmp_path, 0, 3) and boards.made.closed
    for (step, values), row in zip(boards.made.seen, rows(tmp_path), strict=True):
        assert step == int(row["step"])
        for name, value in values.items():
            assert value == pytest.approx(float(row[name.removeprefix("train/")]), rel=1e-4)
    Trainer(Toy(), Data(), TrainConfig(steps=5), tmp_path, log="tensorboard", resume=True).run()
    assert boards.made.begun[1] == 3 and [step for step, _ in boards.made.seen] == [3, 4]


def test_scores_go_to_the_boards_alone(tmp_path, noted):
    board = Noted(tmp_path, 0, {})
    with Logger(tmp_path / "losses.csv", 0, [board]) as log:
        log.write(0, {"total": 1.0, "validation": None})
        log.show(0, "metrics", {"GMR": 2.0})
    assert board.seen == [(0, {"train/total": 1.0}), (0, {"metrics/GMR": 2.0})]
    assert (tmp_path / "losses.csv").read_text().startswith("step,seconds,total,validation\n")


def test_what_is_not_installed_is_said_before_any_work(tmp_path, noted):
    with pytest.raises(
        ValueError, match=r"'wandb' is not installed: pip install .dancediff\[wandb"
    ):
        Trainer(Toy(), Data(), TrainConfig(steps=1), tmp_path / "run", log=["wandb"])
    assert not (tmp_path / "run").exists()


def test_a_folder_of_logs_is_no_module(tmp_path, monkeypatch):
    (tmp_path / "wandb").mkdir()
    monkeypatch.setattr("sys.path", [str(tmp_path)])
    assert not boards._installed("wandb") and not boards._installed("no_such_module")


def test_tensorboard_shows_a_step_once(tmp_path):
    pytest.importorskip("tensorboard")
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    for steps in (4, 6):
        config = TrainConfig(steps=steps, save_every=3)
        Trainer(Toy(), Data(), config, tmp_path, log="tensorboard", resume=True).run()
    found = EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    shown = found.Scalars("train/total")
    assert [one.step for one in shown] == list(range(6))
    for one, row in zip(shown, rows(tmp_path), strict=True):
        assert one.value == pytest.approx(float(row["total"]), rel=1e-4)


def test_wandb_goes_on_with_its_run(tmp_path, monkeypatch):
    pytest.importorskip("wandb")
    monkeypatch.setenv("WANDB_MODE", "offline")
    monkeypatch.setenv("WANDB_SILENT", "true")
    run = tmp_path / "run"
    for steps in (2, 4):
        Trainer(Toy(), Data(), TrainConfig(steps=steps), run, log="wandb", resume=True).run()
    name = (run / "wandb_run.txt").read_text().strip()
    kept = sorted((run / "wandb").glob(f"offline-run-*-{name}/run-{name}.wandb"))
    assert len(kept) == 2 and all(path.stat().st_size > 0 for path in kept)
    Trainer(Toy(), Data(), TrainConfig(steps=1), run, log="wandb", overwrite=True).run()
    assert (run / "wandb_run.txt").read_text().strip() != name
