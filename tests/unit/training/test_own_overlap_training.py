"""What own overlap changes about a training step: the noisy input, in its first half, no more."""

from dataclasses import replace

import torch

from dancediff.data.windows import Batch
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.config import TrainConfig, TrainingExtensions
from dancediff.training.objective import GroupObjective

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 16, "fusion_hidden": 16}


class Watched(TCDiffPP):
    """Keeps what it was given."""

    def forward(self, x_t, t, conditions):
        self.seen = [*getattr(self, "seen", ()), x_t]
        return super().forward(x_t, t, conditions)


def inputs(share: float) -> list[torch.Tensor]:
    torch.manual_seed(0)
    model = Watched(TCDiffPPConfig(**SIZES, num_frames=40))
    config = TrainConfig(extensions=replace(TrainingExtensions(), own_overlap=share))
    g = torch.Generator().manual_seed(1)
    x = torch.randn(4, 2, 40, 151, generator=g)
    batch = Batch(x, torch.randn(4, 40, 35, generator=g), torch.arange(2).expand(4, 2))
    GroupObjective(model, config).losses(model, batch, 5)["total"].backward()
    return model.seen


def test_the_second_half_and_the_noise_stay():
    (plain,), (asked, changed) = inputs(0.0), inputs(1.0)
    assert asked.shape == plain.shape  # the network was asked for its guess of all windows
    assert torch.equal(changed[:, :, 20:], plain[:, :, 20:])
    assert not torch.isclose(changed[:, :, :15], plain[:, :, :15]).all(-1).any()
