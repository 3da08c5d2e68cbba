"""A model that cannot learn one dance by heart will not learn to dance.

The bar is the reconstruction loss, eq. 12, after 450 steps: a tenth of what standing still in the
mean pose would cost, with preconditioning, and a hundredth without. (Without it the network need
only learn the one clip; with it, also to take the noise off the linear guess. So the drop from the
first loss says little: the linear guess starts low.)
"""

import csv

import pytest
import torch

from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import rank_left_to_right
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.motion.representation import unpack
from dancediff.motion.skeleton import forward_kinematics
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.config import TrainConfig, TrainingExtensions
from dancediff.training.statistics import fit_statistics
from dancediff.training.trainer import Trainer

pytestmark = pytest.mark.slow

FRAMES, STEPS, BATCH = 40, 450, 8
SIZES = {"d_model": 64, "num_layers": 2, "num_heads": 2, "ff_dim": 128, "fusion_hidden": 128}


class FewClips:
    """The same clips in every batch, repeated, so that each batch has many noise levels."""

    def __init__(self, takes):
        cuts = [rank_left_to_right(take.x[:, 30 : 30 + FRAMES]) for take in takes]
        x_0, S = (torch.stack(part) for part in zip(*cuts, strict=True))
        M = torch.stack([take.M[30 : 30 + FRAMES] for take in takes])
        self.clips = x_0, M, S
        again = BATCH // len(takes)
        self.repeated = tuple(part.repeat(again, *[1] * (part.ndim - 1)) for part in self.clips)

    def batch(self, step):
        return self.repeated


def learn(song_seeds, folder, *extensions):
    takes = [choreographed_takes(seed, seconds=6.0, sizes=(2,))[0] for seed in song_seeds]
    others = [
        take for seed in (7, 8) for take in choreographed_takes(seed, seconds=6.0, sizes=(2, 3))
    ]
    torch.manual_seed(0)
    names = ("ssd", "aligned_attention", "fusion_residual", "footwork_residual", *extensions)
    model = build(TCDiffPP, TCDiffPPConfig(**SIZES, num_frames=FRAMES), names)
    fit_statistics(
        model, takes + others, TrainingExtensions(metre_unit=True)
    )  # one dance alone would give its pose away
    data = FewClips(takes)
    frames = torch.cat([take.x.flatten(0, 1) for take in takes + others])
    data.mean_pose = model.normalizer.normalize(frames).mean(0)
    config = TrainConfig(steps=STEPS, lr=6e-3, warmup=10, ema=0.9)
    trained = Trainer(model, data, config, folder).run()
    losses = list(csv.DictReader((folder / "losses.csv").read_text().splitlines()))
    return trained, data, losses


@pytest.mark.parametrize(("extensions", "share"), [(("preconditioning",), 0.1), ((), 0.01)])
def test_one_clip_is_learned_by_heart(tmp_path, extensions, share):
    model, data, losses = learn([0], tmp_path, *extensions)
    assert len(losses) == STEPS
    x_0 = model.normalizer.normalize(data.clips[0])
    still = (x_0 - data.mean_pose).square().mean().item()

    def at_end(name):
        return sum(float(row[name]) for row in losses[-10:]) / 10

    assert at_end("simple") < share * still
    for name in ("total", "fk", "dist"):
        assert at_end(name) < float(losses[0][name]) / 10, name


def joints(x):
    _, root, pose = unpack(x)
    return forward_kinematics(pose, root)


def guess(model, data, M):
    """What the model says when it sees nothing but noise and music: joints in metres."""
    x_0, _, S = data.clips
    x_T = torch.randn(x_0.shape, generator=torch.Generator().manual_seed(5))
    with torch.no_grad():
        _, x_hat = model(
            x_T, torch.full((len(x_0),), 999), Conditions(model.music_normalizer.normalize(M), S)
        )
    return joints(model.normalizer.unnormalize(x_hat))


def distance(a, b):
    return (a - b).norm(dim=-1).mean(dim=(1, 2, 3))


def test_music_alone_tells_which_dance(tmp_path):
    """From pure noise, each song brings back its own clip; the songs exchanged, the other one."""
    model, data, _ = learn([0, 1], tmp_path, "preconditioning")
    x_0, M, S = data.clips
    assert torch.equal(S[0], S[1]), "the swap mode would give the clip away"
    truth = joints(x_0)
    other = distance(truth.flip(0), truth)
    assert (distance(truth, guess(model, data, M)) < 0.4 * other).all()
    assert (distance(truth.flip(0), guess(model, data, M.flip(0))) < 0.4 * other).all()
