"""Exercises of lessons 00 to 04: dances as tensors, music, data, noise."""

import numpy as np
import torch

from dancediff.diffusion.schedule import cosine_abar, q_sample
from dancediff.exercises.exercise import Exercise
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_rot6d, rot6d_to_matrix
from dancediff.music.features import BEATS, FPS


def _tempo(M):
    return 60 * FPS / float(np.median(np.diff(np.flatnonzero(np.asarray(M)[:, BEATS.start] > 0.5))))


def _tempo_cases() -> list[tuple]:
    steady, gap = torch.zeros(300, 35), torch.zeros(300, 35)
    steady[7::15, BEATS] = 1  # 120 beats a minute
    gap[7::20, BEATS] = 1  # 90, and the tracker has missed two
    gap[[67, 187], BEATS] = 0
    return [(steady,), (gap,)]


def _rotation_cases() -> list[tuple]:
    R = axis_angle_to_matrix(torch.tensor([[0.3, -1.1, 0.4], [0.0, 2.0, 1.0]]))
    d6 = matrix_to_rot6d(R)
    stretched = d6 * torch.tensor([2.0, 2, 2, 0.5, 0.5, 0.5])
    bent = stretched + 0.3 * stretched[..., [3, 4, 5, 0, 1, 2]]  # the rows are no longer square
    return [(d6,), (stretched,), (bent,)]


def _leaks(train, test):
    return sum(any(a == b and abs(s - t) < 150 for b, t in train) for a, s in test)


def _leaks_cases() -> list[tuple]:
    grid = [(take, start) for take in "abc" for start in range(0, 451, 75)]
    by_take = ([w for w in grid if w[0] != "b"], [w for w in grid if w[0] == "b"])
    apart = ([("a", 0), ("b", 150)], [("a", 150), ("b", 0), ("c", 0)])  # they touch, no more
    return [(grid[::2], grid[1::2]), by_take, apart, ([("a", 100), ("a", 130)], [("a", 0)])]


def _x0_from(x_t, eps, t, abar):
    return (x_t - (1 - abar[t]).sqrt() * eps) / abar[t].sqrt()


def _x0_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    abar = cosine_abar(1000)
    x_0, eps = (torch.randn(2, 3, 4, generator=draw, dtype=torch.float64) for _ in range(2))
    return [(q_sample(x_0, t, abar, eps), eps, t, abar) for t in (0, 250, 800)]


EXERCISES = {
    "00.1": Exercise(
        "a seed names a dance",
        {"same seed again": True, "another seed": False, "another song": False},
        "a seed fixes the noise a dance starts from; noise, song and settings fix the rest",
    ),
    "01.1": Exercise(
        "six numbers to a rotation",
        rot6d_to_matrix,
        "rows: make the first one unit length, take its share out of the second, make that unit "
        "length too; the third is their cross product, in this order",
        _rotation_cases,
    ),
    "02.1": Exercise(
        "beats per minute",
        _tempo,
        f"column 34 marks beats at {FPS} frames a second; the tracker may miss a beat, so take "
        "the median of the gaps, not their mean",
        _tempo_cases,
    ),
    "03.1": Exercise(
        "find the leak",
        _leaks,
        "two windows share a frame when they are of one take and their starts differ by less than "
        "150, to either side; count each test window once",
        _leaks_cases,
    ),
    "04.1": Exercise(
        "undo the noise",
        _x0_from,
        "solve x_t = √ᾱ x_0 + √(1-ᾱ) ε for x_0, with ᾱ = abar[t]; mind both roots",
        _x0_cases,
    ),
}
