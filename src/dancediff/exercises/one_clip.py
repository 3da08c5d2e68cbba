"""One second of three dancers, learned by heart by small networks: what lesson 05 trains on.

Read first: lesson 05 · `dancediff.papers.tcdiffpp.model`.

Symbols (axes: n dancers · f frames · d motion, m music features)
    x    the dance, dancers from left to right      (n, f, d)
    S    their order in the end                     (n,)
    M    the music                                  (f, m)
"""

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from dancediff.data.choreographer import choreograph
from dancediff.data.take import DanceTake
from dancediff.data.windows import rank_left_to_right
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.extensions.build import build
from dancediff.hub import packaged_song
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.config import TrainingExtensions
from dancediff.training.statistics import fit_statistics

FRAMES = slice(65, 95)  # of a dance to the packaged song
EXTENSIONS = ("ssd", "aligned_attention", "fusion_residual", "footwork_residual")


@dataclass(frozen=True)
class OneClip:
    """The clip, and what lesson 05 does with it again and again."""

    x: Tensor
    S: Tensor
    M: Tensor

    @property
    def take(self) -> DanceTake:
        """As training reads it."""
        return DanceTake("clip", self.x, M=self.M)

    @property
    def truth(self) -> Motion:
        """As one sees it."""
        return Motion.from_features(self.x)

    def fresh_model(self) -> TCDiffPP:
        """A small network with the clip's scales; always the same weights."""
        torch.manual_seed(5)
        sizes: dict[str, Any] = {"d_model": 64, "num_layers": 2, "ff_dim": 128}
        config = TCDiffPPConfig(num_frames=30, max_dancers=3, fusion_hidden=128, **sizes)
        model = build(TCDiffPP, config, EXTENSIONS)
        fit_statistics(model, [self.take], TrainingExtensions(metre_unit=True))
        return model

    def danced(self, model: TCDiffPP) -> Motion:
        """From noise, always the same, to a dance in ten steps of DDIM."""
        music = model.music_normalizer.normalize(self.M)[None]
        conditions = Conditions(music, self.S[None])
        x_0 = sample(
            lambda x_t, t: model.denoise(x_t, torch.tensor([t]), conditions),
            (1, *self.x.shape),
            # on the floor 1 is 1 m: who stands farther out is not cut off
            SamplerOptions(model.abar, "ddim", 10, eta=1.0, clamp=None),
            generator=torch.Generator().manual_seed(1),
        )
        return Motion.from_features(model.normalizer.unnormalize(x_0)[0])

    def slip(self, motion: Motion) -> float:
        """Mean speed, m/s, of the feet that stand in the clip."""
        feet = motion.joints()[:, :, FOOT_JOINTS]
        return (30 * feet.diff(dim=1).norm(dim=-1))[self.x[:, :-1, :4] > 0.5].mean().item()

    def strayed(self, motion: Motion) -> float:
        """Mean error of the offset between two dancers, in cm."""
        error = motion.root - self.truth.root
        i, j = torch.triu_indices(len(error), len(error), 1)
        return 100 * (error[i] - error[j]).norm(dim=-1).mean().item()


def one_clip() -> OneClip:
    """The clip of lesson 05.

    >>> clip = one_clip()
    >>> tuple(clip.x.shape), clip.strayed(clip.truth)
    ((3, 30, 151), 0.0)
    """
    song = packaged_song()
    dance, _ = choreograph(song.beats(), dancers=3, seed=5, seconds=8)
    x, S = rank_left_to_right(dance.features()[:, FRAMES])
    return OneClip(x, S, song.features()[FRAMES])
