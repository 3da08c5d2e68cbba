"""A local denoiser that cannot learn two clips by heart will not learn to dance.

The bars are those of `test_overfit`: the reconstruction loss after the last step against what
standing still in the mean pose would cost, and the clip that comes back out of pure noise.
"""

import csv

import pytest
import torch

from dancediff.data.choreographed import make_choreographed
from dancediff.data.windows import SoloCut, WindowSampler
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.lodge_stages import ExtendedLocalDenoiser
from dancediff.motion.representation import LODGE, at_origin, joints_of
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.losses import LodgeWeights
from dancediff.training.config import TrainConfig, TrainingExtensions
from dancediff.training.lodge import fit_stage
from dancediff.training.lodge_data import solos_of
from dancediff.training.lodge_losses import LodgeObjective
from dancediff.training.trainer import Trainer

pytestmark = pytest.mark.slow

FRAMES, STEPS, BATCH = 40, 400, 8
SIZES = {"d_model": 64, "num_layers": 2, "num_heads": 2, "ff_dim": 128, "dropout": 0.0}


class FewClips:
    """The same clips in every batch, repeated, so that each batch has many noise levels."""

    def __init__(self, x, M, genre):
        self.clips = x, M, genre
        again = BATCH // len(x)
        self.repeated = tuple(part.repeat(again, *[1] * (part.ndim - 1)) for part in self.clips)

    def batch(self, step):
        return self.repeated


@pytest.fixture(scope="module")
def solos():
    takes = [make_choreographed(k, 1, seconds=6.0) for k in (0, 1, 7, 8)]
    return solos_of(takes, tuple(sorted({take.genre for take in takes})))


def learn(solos, folder, *, same_music):
    """Two clips that differ in their music and share a genre, or the other way round."""
    genres = tuple(sorted({solo.genre for solo in solos}))
    torch.manual_seed(0)
    sizes = LocalConfig(**SIZES, num_frames=FRAMES, genres=genres, style_noise=8)
    model = ExtendedLocalDenoiser(sizes, ["preconditioning", "style_film"])
    extensions = TrainingExtensions(metre_unit=True)
    fit_stage(model, WindowSampler(solos, SoloCut(FRAMES, genres)), extensions)
    part = slice(30, 30 + FRAMES)
    x = torch.stack([at_origin(solo.x[0, part, :139]) for solo in solos[:2]])
    M = torch.stack([solo.songs[0][part] for solo in solos[:2]])
    if same_music:
        M, genre = M[:1].repeat(2, 1, 1), torch.tensor([0, 1])
    else:
        genre = torch.tensor([0, 0])
    data = FewClips(x, M, genre)
    config = TrainConfig(steps=STEPS, lr=6e-3, warmup=10, ema=0.9, weights=LodgeWeights.local())
    objective = LodgeObjective(model, config)
    trained = Trainer(model, data, config, folder, objective=objective).run()
    losses = list(csv.DictReader((folder / "losses.csv").read_text().splitlines()))
    mean = torch.cat([model.normalizer.normalize(solo.x[0, :, :139]) for solo in solos]).mean(0)
    still = (model.normalizer.normalize(x) - mean).square().mean().item()
    return trained, data, losses, still


def guess(model, M, genre):
    """What the model says when it sees nothing but noise, music and genre: joints in metres."""
    g = torch.Generator().manual_seed(5)
    x_T = torch.randn(len(M), FRAMES, 139, generator=g)
    with torch.no_grad():
        style = model.style(genre, torch.randn(len(M), 8, generator=g))
        steps = torch.full((len(M),), 999)
        x_hat = model(x_T, steps, Conditions(model.music_normalizer.normalize(M), style=style))[1]
    return joints_of(model.normalizer.unnormalize(x_hat), LODGE)


def distance(a, b):
    return (a - b).norm(dim=-1).mean(dim=(1, 2))


def test_music_alone_tells_which_clip(solos, tmp_path):
    """From pure noise, each song brings back its own clip; the songs exchanged, the other one."""
    model, data, losses, still = learn(solos, tmp_path, same_music=False)

    assert sum(float(row["recon"]) for row in losses[-10:]) / 10 < 0.1 * still
    x, M, genre = data.clips
    truth = joints_of(x, LODGE)
    other = distance(truth.flip(0), truth)
    assert (distance(truth, guess(model, M, genre)) < 0.4 * other).all()
    assert (distance(truth.flip(0), guess(model, M.flip(0), genre)) < 0.4 * other).all()


def test_genre_alone_tells_which_clip(solos, tmp_path):
    """The same song, two genres: the style token decides, whatever its noise."""
    model, data, _, _ = learn(solos, tmp_path, same_music=True)
    x, M, genre = data.clips
    truth = joints_of(x, LODGE)
    other = distance(truth.flip(0), truth)
    assert (distance(truth, guess(model, M, genre)) < 0.4 * other).all()
    assert (distance(truth.flip(0), guess(model, M, genre.flip(0))) < 0.4 * other).all()
