"""Exercises of lesson 13: what the metrics measure."""

from dataclasses import replace

import numpy as np

from dancediff.exercises.exercise import Exercise


def _dances() -> list[tuple]:
    from dancediff.data.choreographer import choreograph

    grid = np.arange(0.3, 6, 0.5)
    return [(choreograph(grid, dancers=2, seed=seed, seconds=6)[0],) for seed in (1, 2)]


def _stand_still(dance):
    return replace(dance, pose=0 * dance.pose + dance.pose[:, :1], root=0 * dance.root)


def _fools_pfc(got, dance) -> str:
    from dancediff.metrics.physical import pfc
    from dancediff.metrics.rhythm import beat_alignment
    from dancediff.motion.motion import Motion

    if not isinstance(got, Motion):
        return f"type {type(got).__name__}, expected a Motion"
    if got.root.shape != dance.root.shape:
        return f"shape {tuple(got.root.shape)} of the root, expected {tuple(dance.root.shape)}"
    beats = np.arange(0.3, 6, 0.5)
    for name, metric in (
        ("PFC", pfc),
        ("BAS", lambda joints: beat_alignment(joints, beats)),
    ):
        mine, its = metric(got.joints()), metric(dance.joints())
        if not mine <= its / 2:
            return f"your {name} is {mine:.3g}, expected at most half of the dance's {its:.3g}"
    return ""


EXERCISES = {
    "13.1": Exercise(
        "make a metric lie",
        _stand_still,
        "PFC multiplies the root's acceleration with how far the feet travel: what if nobody "
        "travels? And BAS needs moments of rest between movements",
        _dances,
        _fools_pfc,
    ),
}
