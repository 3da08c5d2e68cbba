"""Metrics during training: dances of the averaged network, beside a training's checkpoint."""

import csv

import pytest
import torch

from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.config import TrainConfig
from dancediff.training.evaluator import Evaluator
from dancediff.training.trainer import Trainer
from dancediff.training.validation_metrics import BATCHES, METRICS, ValidationMetrics, dance_windows
from duets import duets


@pytest.fixture(scope="module")
def windows():
    """Of four duets to a steady beat."""
    return WindowSampler(duets(), GroupCut(150), dancers_per_batch=4)


def test_a_training_writes_a_row_each_time_and_replaces_it_when_run_again(windows, tmp_path):
    path, found = tmp_path / "metrics.csv", []
    for steps in (3, 5):  # the second goes on
        torch.manual_seed(0)
        model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32))
        config = TrainConfig(steps=steps, metrics_every=2, save_every=1)
        evaluator = Evaluator(windows, config, metrics=ValidationMetrics(windows, path))
        Trainer(model, windows, config, tmp_path, evaluator=evaluator, resume=True).run()
        found.append(list(csv.DictReader(path.read_text().splitlines())))
    assert [row["step"] for row in found[0]] == ["2"]
    assert [row["step"] for row in found[1]] == ["2", "4"]
    assert found[1][0] == found[0][0]
    assert set(METRICS) < set(found[0][0])
    assert all(float(row["joint speed"]) > 0 for row in found[1])


class Truth:
    """Stands for a network that knows each dance: it guesses the batch it was last given."""

    def __init__(self):
        self.abar, self.normalizer, self.modules = torch.linspace(0.999, 0.001, 1000), self, tuple

    def to_network(self, batch):
        self.batch = batch
        return batch

    def denoise(self, x_t, t, conditions):
        assert torch.equal(conditions.swap, self.batch.label)
        assert torch.equal(conditions.music, self.batch.M)
        return self.batch.x

    def unnormalize(self, x):
        return x

    def with_draws(self, conditions, generator):
        return conditions


def test_windows_are_danced_under_their_own_conditions(windows):
    truth = Truth()
    batch = truth.to_network(windows.batch(0))
    assert torch.equal(dance_windows(truth, batch, seed=0), batch.x)


def test_dances_that_are_the_reference_have_no_distance_to_it(windows):
    class Again:
        """The same batches as dances and as what they are compared with."""

        def batch(self, number):
            return windows.batch(number % BATCHES)

    truth = Truth()
    row = ValidationMetrics(Again(), None).row(truth, truth, 1)
    assert row["FID_k"] == pytest.approx(0, abs=1e-3)
    assert row["GMR"] == pytest.approx(0, abs=1e-3)
    assert ValidationMetrics(windows, None).row(truth, truth, 1)["FID_k"] > 1
