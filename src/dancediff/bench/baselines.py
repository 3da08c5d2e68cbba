"""Dances that nobody learned: what every system of a bench has to beat.

Read first: `dancediff.bench.held_out`.
"""

from collections.abc import Callable, Sequence

import torch

from dancediff.bench.held_out import Window
from dancediff.motion.motion import Motion
from dancediff.motion.representation import TCDIFFPP

TRUTH = "held-out dances"


def true_dances(some: Sequence[Window]) -> list[Motion]:
    """The windows' own dances: what would be perfect."""
    return [window.motion for window in some]


def mean_poses(some: Sequence[Window]) -> list[Motion]:
    """Everybody stands at the own mean place in the mean pose of all windows.

    It is the mean of rotations' six numbers, made a rotation again.
    """
    features = [window.motion.features() for window in some]
    pose = torch.cat([x.flatten(0, 1) for x in features]).mean(0)
    still = []
    for x, window in zip(features, some, strict=True):
        held = pose.expand_as(x).clone()
        held[..., TCDIFFPP.root] = window.motion.root.mean(1, keepdim=True)
        still.append(Motion.from_features(held))
    return still


def shuffled_frames(some: Sequence[Window], seed: int = 0) -> list[Motion]:
    """The true dances, each with its frames in an order drawn at random."""
    generator = torch.Generator().manual_seed(seed)
    mixed = []
    for window in some:
        order = torch.randperm(window.motion.num_frames, generator=generator)
        mixed.append(Motion(window.motion.pose[:, order], window.motion.root[:, order]))
    return mixed


BASELINES: dict[str, Callable[[Sequence[Window]], list[Motion]]] = {
    TRUTH: true_dances,
    "mean pose": mean_poses,
    "shuffled frames": shuffled_frames,
}
