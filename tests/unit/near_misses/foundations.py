"""Plausible wrong answers to the exercises of lessons 00 to 04."""

import numpy as np
import torch

from dancediff.motion.rotation import rot6d_to_matrix


def six_as_columns(d6):
    return rot6d_to_matrix(d6).mT


def six_not_squared(d6):
    a, b = (torch.nn.functional.normalize(v, dim=-1) for v in (d6[..., :3], d6[..., 3:]))
    return torch.stack([a, b, torch.linalg.cross(a, b)], dim=-2)


def six_left_handed(d6):
    R = rot6d_to_matrix(d6)
    return torch.cat([R[..., :2, :], -R[..., 2:, :]], dim=-2)


def six_changes_nothing(d6):
    return torch.eye(3).expand(*d6.shape[:-1], 3, 3)


def beat_frames(M):
    return np.flatnonzero(np.asarray(M)[:, 34] > 0.5)


NEAR_MISSES = {
    "00.1": [
        {"same seed again": False, "another seed": False, "another song": False},
        {"same seed again": True, "another seed": False, "another song": True},
        {"same seed again": True},
        True,
    ],
    "01.1": [six_as_columns, six_not_squared, six_left_handed, six_changes_nothing],
    "02.1": [
        lambda M: 60 * 30 / np.diff(beat_frames(M)).mean(),  # minds a missing beat
        lambda M: 60 / np.median(np.diff(beat_frames(M))),  # takes frames for seconds
        lambda M: 60 * 30 * len(beat_frames(M)) / len(M),
        lambda M: np.diff(beat_frames(M)),
    ],
    "03.1": [
        lambda train, test: sum(w in train for w in test),  # only the very same window
        lambda train, test: sum(take in {a for a, _ in train} for take, _ in test),  # any of a take
        lambda train, test: sum(a == b and abs(s - t) < 150 for a, s in test for b, t in train),
        lambda train, test: sum(
            any(a == b and abs(s - t) <= 150 for b, t in train) for a, s in test
        ),
        lambda train, test: sum(any(abs(s - t) < 150 for _, t in train) for _, s in test),
    ],
    "04.1": [
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]) * eps) / abar[t].sqrt(),  # no root
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]).sqrt() * eps) / abar[t],
        lambda x_t, eps, t, abar: (x_t + (1 - abar[t]).sqrt() * eps) / abar[t].sqrt(),
        lambda x_t, eps, t, abar: x_t - eps,
    ],
}
