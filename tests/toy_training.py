"""A training of one weight, so that a step takes milliseconds."""

import csv
from dataclasses import dataclass
from types import SimpleNamespace

import torch
from torch import nn

from dancediff.diffusion.schedule import cosine_abar
from dancediff.motion.representation import Normalizer
from dancediff.training.trainer import Trainer


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

    def forward(self, x_t, t, conditions):
        self.heard.append((t, conditions.music_mask))
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


def train(*args, **options):
    return Trainer(*args, **options).run()


def rows(folder):
    return list(csv.DictReader((folder / "losses.csv").read_text().splitlines()))
