"""A model that cannot learn two dances by heart will not learn to dance."""

import csv

import pytest
import torch

from dancediff.data.windows import choreographed_takes, rank_left_to_right
from dancediff.motion.representation import unpack
from dancediff.motion.skeleton import forward_kinematics
from dancediff.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.loop import TrainConfig, train
from dancediff.training.run import fit_normalizers

FRAMES, STEPS = 40, 150
SIZES = {"d_model": 64, "num_layers": 2, "num_heads": 2, "ff_dim": 128, "fusion_hidden": 128}


class TwoClips:
    """The same two clips in every batch, four times each, so that each batch has many t."""

    def __init__(self, takes):
        cuts = [rank_left_to_right(take.x[:, 30 : 30 + FRAMES]) for take in takes]
        x_0, S = (torch.stack(part) for part in zip(*cuts, strict=True))
        M = torch.stack([take.M[30 : 30 + FRAMES] for take in takes])
        self.clips = x_0, M, S
        self.batches = tuple(part.repeat(4, *[1] * (part.ndim - 1)) for part in self.clips)

    def batch(self, step):
        return self.batches


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("overfit")
    takes = [choreographed_takes(seed, seconds=6.0, sizes=(2,))[0] for seed in (0, 1)]
    torch.manual_seed(0)
    model = TCDiffPP(TCDiffPPConfig(**SIZES, num_frames=FRAMES, head_dim=32, d_state=4))
    fit_normalizers(model, takes)
    data = TwoClips(takes)
    config = TrainConfig(steps=STEPS, lr=3e-3, warmup=10, ema=0.9)
    trained = train(model, data, config, folder)
    losses = list(csv.DictReader((folder / "losses.csv").read_text().splitlines()))
    return trained, data, losses


def test_loss_drops_tenfold(run):
    total = [float(row["total"]) for row in run[2]]
    assert sum(total[-10:]) < 0.1 * sum(total[:10])


@pytest.mark.parametrize("name", ["simple", "vel", "fk", "dist"])
def test_every_term_falls(run, name):
    values = [float(row[name]) for row in run[2]]
    assert sum(values[-10:]) < 0.3 * sum(values[:10])


def guess(model, data, M):
    """What the model says when it sees nothing but noise and music: joints in metres."""
    x_0, _, S = data.clips
    x_T = torch.randn(x_0.shape, generator=torch.Generator().manual_seed(5))
    with torch.no_grad():
        _, x_hat = model(x_T, torch.full((len(x_0),), 999), model.music_normalizer.normalize(M), S)
    return joints(model.normalizer.unnormalize(x_hat))


def joints(x):
    _, root, pose = unpack(x)
    return forward_kinematics(pose, root)


def distance(a, b):
    return (a - b).norm(dim=-1).mean(dim=(1, 2, 3))


def test_music_alone_tells_which_dance(run):
    """From pure noise, each song brings back its own clip; the songs exchanged, the other one."""
    model, data, _ = run
    x_0, M, S = data.clips
    assert torch.equal(S[0], S[1]), "the swap mode would give the clip away"
    truth = joints(x_0)
    own, other = distance(truth, guess(model, data, M)), distance(truth.flip(0), truth)
    exchanged = distance(truth.flip(0), guess(model, data, M.flip(0)))
    assert (own < 0.25 * other).all() and (exchanged < 0.25 * other).all()
