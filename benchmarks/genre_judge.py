r"""Which genre is a dance of? A classifier of windows of 256 frames, trained on takes.

Used by lodge_bars.py and any_song.py.

Symbols (axes: f frames · d = 139 features of Lodge)
    x   one dancer's motion features   (f, d)
"""

from collections.abc import Iterable

import numpy as np
import torch
from sklearn.linear_model import LogisticRegression
from sklearn.pipeline import Pipeline, make_pipeline
from sklearn.preprocessing import StandardScaler
from torch.nn.functional import conv1d

from dancediff.data.choreographer import GENRES, choreograph
from dancediff.genre import TEMPOS
from dancediff.metrics.kinetic import kinetic_features
from dancediff.motion.motion import Motion
from dancediff.motion.representation import LODGE, with_hands
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix

FPS, LOCAL = 30, 256


def trained_judge(solos: Iterable[tuple[torch.Tensor, str]], draw: torch.Generator) -> Pipeline:
    """Fit on solos (f, d) and their genres, each as it is and shaken."""
    rows = []
    for x, genre in solos:
        for part in in_windows(x):
            rows += [(described(part), genre), (described(shaken(part, draw)), genre)]
    judge = make_pipeline(
        StandardScaler(), LogisticRegression(C=0.02, max_iter=2000, class_weight="balanced")
    )
    return judge.fit(np.stack([row for row, _ in rows]), [genre for _, genre in rows])


def choreographed_solos(seeds: Iterable[int], seconds: float = 35.0):
    """Trios of the choreographer in all genres, at tempi that suit them: (f, d) and the genre."""
    for seed in seeds:
        rng = np.random.default_rng([seed, 7])
        for genre in GENRES:
            beats = np.arange(rng.uniform(0, 0.5), seconds, 60 / rng.uniform(*TEMPOS[genre]))
            options = {"genre": genre, "seconds": seconds, "seed": seed}
            dance, _ = choreograph(beats, dancers=3, **options)
            for x in dance.features("lodge"):
                yield x, genre


def in_windows(x: torch.Tensor) -> list[torch.Tensor]:
    """A take (f, d) in pieces as long as a local segment."""
    return [x[start : start + LOCAL] for start in range(0, len(x) - LOCAL + 1, LOCAL)]


def shaken(x: torch.Tensor, draw: torch.Generator) -> torch.Tensor:
    """A take whose joints sway by up to a few degrees, as no choreographer's but a network's do.

    A judge that never met such jitter takes it for a sign of capture: it called every dance of a
    network salsa or Indian, whatever was asked for, and every shaken take as well.
    """
    fade = torch.hann_window(9, periodic=False)
    noise = torch.randn(132, 1, len(x) + 8, generator=draw)
    sway = conv1d(noise, (fade / fade.norm())[None, None])[:, 0].T
    y = x.clone()
    y[:, LODGE.rot6d] += 0.1 * torch.rand(1, generator=draw) * sway
    R = rot6d_to_matrix(y[:, LODGE.rot6d].unflatten(-1, (-1, 6)))
    y[:, LODGE.rot6d] = matrix_to_rot6d(R).flatten(-2)
    return y


def described(x: torch.Tensor) -> np.ndarray:
    """What the classifier sees of a window (f, d): where joints turn, how much, how fast."""
    motion = Motion.from_features(with_hands(x)[None], fps=FPS)
    pose = x[:, 7:]
    parts = [
        pose.mean(0),
        pose.std(0),
        pose.diff(dim=0).abs().mean(0),
        kinetic_features(motion.joints())[0].log1p(),
    ]
    return torch.cat([part.float() for part in parts]).numpy()


def verdict(judge: Pipeline, *dancers: torch.Tensor) -> str:
    """The likeliest genre of a dance, all windows of all its dancers (f, d) taken together."""
    rows = np.stack([described(part) for x in dancers for part in in_windows(x)])
    return str(judge.classes_[judge.predict_log_proba(rows).sum(0).argmax()])
