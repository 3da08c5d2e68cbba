"""Plausible wrong answers to the exercises of lessons 00 to 04."""

import numpy as np
import torch

from dancediff.diffusion.schedule import cosine_abar
from dancediff.motion.rotation import rot6d_to_matrix, rotation_about
from dancediff.motion.skeleton import world_rotations


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


def arm_up(turn, straight=True):
    """Raise the left arm: ``turn`` of the pose is the new rotation of the shoulder."""

    def answer(pose):
        pose = pose.clone()
        if straight:
            pose[[18, 20]] = torch.eye(3)
        pose[16] = turn(pose)
        return pose

    return answer


def quarter(sign=1):
    return rotation_about("z", torch.tensor(sign * torch.pi / 2))


def stand_up_first(pose):
    pose = pose.clone()
    pose[:16] = torch.eye(3)
    return arm_up(lambda _: quarter())(pose)


def slice_first(sound, starts, features):
    return np.stack([features(sound[512 * s : 512 * (s + 150)])[:150] for s in starts])


def one_song_out(takes):
    return {name for name, song, _ in takes if song == takes[0][1]}


def only_parts_stay(takes):
    test = set()
    for name, _, parts in takes[::-1]:
        if len(test) < len(takes) / 10:
            test |= {name, *parts}
    return test


def per_clip(train, new):
    low, high = new.amin(1, keepdim=True), new.amax(1, keepdim=True)
    return 2 * (new - low) / (high - low).clamp_min(1e-6) - 1


def scale_of(*clips):
    return torch.cat(clips).amin((0, 1)), torch.cat(clips).amax((0, 1))


def scaled(new, low, high):
    return 2 * (new - low) / (high - low) - 1


NEAR_MISSES = {
    "00.1": [
        {"same seed again": False, "another seed": False, "another song": False},
        {"same seed again": True, "another seed": False, "another song": True},
        {"same seed again": True},
        True,
    ],
    "00.2": [
        {"twice the steps": 1, "twice the dancers": 2, "twice the seconds": 2},
        {"twice the steps": 2, "twice the dancers": 1, "twice the seconds": 2},  # frame by frame
        {"twice the steps": 2, "twice the dancers": 2, "twice the seconds": 1},  # one at a time
        [2, 1, 1],
    ],
    "01.1": [six_as_columns, six_not_squared, six_left_handed, six_changes_nothing],
    "01.2": [
        {"18 left elbow": 3, "22 left hand": 1, "9 chest": 13, "0 root": 24},  # the joint itself
        {"18 left elbow": 2, "22 left hand": 0, "9 chest": 3, "0 root": 3},  # children only
        {"18 left elbow": 2, "22 left hand": 0, "9 chest": 12, "0 root": 0},
        {"18 left elbow": 21, "22 left hand": 23, "9 chest": 11, "0 root": 0},  # what stays
    ],
    "01.3": [
        arm_up(lambda pose: quarter()),  # leans with the body
        arm_up(lambda pose: quarter() @ world_rotations(pose)[13].mT),  # the wrong way round
        arm_up(lambda pose: world_rotations(pose)[16].mT @ quarter()),  # minds its own turn, too
        arm_up(lambda pose: world_rotations(pose)[13].mT @ quarter(-1)),  # down
        arm_up(lambda pose: world_rotations(pose)[13].mT @ quarter(), straight=False),
        arm_up(lambda pose: world_rotations(pose)[13] @ quarter()),  # no inverse
        arm_up(lambda pose: torch.zeros(3, 3)),
        stand_up_first,
        lambda pose: pose,
    ],
    "01.4": [
        lambda: ([1.0, 0, 0, 0, 1, 0], [1.0, 0, 0, 0, 1.01, 0]),  # rows at right angles
        lambda: ([1.0, 0, 0, 1, 0, 0], [1.0, 0, 0, 1, 0.01, 0]),  # parallel
        lambda: ([1.0, 0, 0, 0, 0.004, 0], [1.0, 0, 0, 0, -0.004, 0]),  # too short
        lambda: ([1.0, 0, 0, 1, 0.1, 0], [1.0, 0, 0, 1, -0.1, 0]),  # too far apart
        lambda: ([1.0, 0, 0, 0, 1, 0], [-1.0, 0, 0, 0, 1, 0]),
        lambda: [1.0, 0, 0, 1, 0.004, 0],  # one only
    ],
    "02.1": [
        lambda M: 60 * 30 / np.diff(beat_frames(M)).mean(),  # minds a missing beat
        lambda M: 60 / np.median(np.diff(beat_frames(M))),  # takes frames for seconds
        lambda M: 60 * 30 * len(beat_frames(M)) / len(M),
        lambda M: np.diff(beat_frames(M)),
    ],
    "02.2": [
        {"onset": True, "mfcc": True, "chroma": False, "peaks": False, "beats": False},
        {"onset": True, "mfcc": True, "chroma": True, "peaks": False, "beats": False},
        {"onset": False, "mfcc": False, "chroma": False, "peaks": False, "beats": False},
        {"onset": True, "mfcc": True, "chroma": True, "peaks": True, "beats": True},
    ],
    "02.3": [
        slice_first,  # what EDGE does
        lambda sound, starts, features: np.stack(
            [features(sound[s : s + 512 * 150])[:150] for s in starts]
        ),  # takes frames for samples
        lambda sound, starts, features: np.stack(
            [features(sound[: 512 * (s + 150)])[s : s + 150] for s in starts]
        ),  # knows the past, not what is to come
        lambda sound, starts, features: np.stack([features(sound)[s : s + 151] for s in starts]),
        lambda sound, starts, features: np.stack([features(sound)[:150] for s in starts]),
        lambda sound, starts, features: features(sound),
    ],
    "02.4": [
        lambda: np.full((128, 2), -40.0),  # nothing begins
        lambda: np.tile([-40.0, -20.0], (128, 1)),  # both hear it
        lambda: np.tile([-20.0, -40.0], (128, 1)),  # nobody does
        lambda: np.repeat([[-42.0, -38.0], [-38.0, -42.0]], 64, axis=0),  # too faint
        lambda: np.repeat([[-40.0, 20.0], [-40.0, -100.0]], 64, axis=0),  # no such decibels
        lambda: np.repeat([[-60.0, -20.0], [-20.0, -60.0]], 64, axis=0).T,
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
    "03.2": [
        lambda height: 9.81 / -height.diff(n=2).mean(),  # no root
        lambda height: (9.81 / height.diff().abs().mean()) ** 0.5,  # a speed, not its change
        lambda height: (9.81 / 2 / -height.diff(n=2).mean()) ** 0.5,  # half of g is for places
        lambda height: (-height.diff(n=2).mean() / 9.81) ** 0.5,  # seconds a frame
        lambda height: 60.0,  # believes the header
    ],
    "03.3": [
        lambda takes: {name for name, *_ in takes[::5]},  # takes as they come
        one_song_out,  # parts are torn
        only_parts_stay,  # songs are torn
        lambda takes: {name for name, _, parts in takes if parts},  # all that is composed
        lambda takes: {name for name, *_ in takes},
        lambda takes: [],
        lambda takes: {song for _, song, _ in takes[:3]},
    ],
    "03.4": [
        per_clip,  # what TCDiff does
        lambda train, new: scaled(new, *scale_of(train[-1:])),  # the last clip's scale
        lambda train, new: scaled(new, *scale_of(train, new)),  # has seen the test
        lambda train, new: scaled(new, *scale_of(train)).clamp(-1, 1),  # hides what is new
        lambda train, new: scaled(new, train.amin(), train.amax()),  # one scale for all channels
        lambda train, new: (new - train.mean((0, 1))) / train.std((0, 1)),
    ],
    "04.1": [
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]) * eps) / abar[t].sqrt(),  # no root
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]).sqrt() * eps) / abar[t],
        lambda x_t, eps, t, abar: (x_t + (1 - abar[t]).sqrt() * eps) / abar[t].sqrt(),
        lambda x_t, eps, t, abar: x_t - eps,
    ],
    "04.2": [
        lambda x_s, s, t, abar, eps: (
            abar[t].sqrt() * x_s + (1 - abar[t]).sqrt() * eps
        ),  # from s = 0
        lambda x_s, s, t, abar, eps: (
            (abar[t] / abar[s]).sqrt() * x_s + (1 - abar[t]).sqrt() * eps
        ),  # all the noise a second time
        lambda x_s, s, t, abar, eps: (
            (abar[t] / abar[s]).sqrt() * x_s + (abar[s] - abar[t]).sqrt() * eps
        ),
        lambda x_s, s, t, abar, eps: (
            (abar[t - s].sqrt() * x_s) + (1 - abar[t - s]).sqrt() * eps
        ),  # as if all steps were alike
        lambda x_s, s, t, abar, eps: (
            (abar[t] / abar[s]) * x_s + (1 - abar[t] / abar[s]) * eps
        ),  # no roots
    ],
    "04.3": [
        {"sway": 70, "kick": 310, "tremble": 650},
        {"sway": 310, "kick": 650, "tremble": 70},
        {"sway": 310, "kick": 310, "tremble": 310},  # all at once
        {"sway": 650, "kick": 310},
    ],
    "04.4": [
        lambda eps, abar: (500, eps + 0.1),  # too early
        lambda eps, abar: (999, eps + 0.1),  # too late
        lambda eps, abar: (960, torch.zeros_like(eps)),  # a large loss
        lambda eps, abar: (960, eps),  # the right guess
        lambda eps, abar: (960, eps + 0.01),
        lambda eps, abar: (960, eps[0]),
    ],
    "04.5": [
        cosine_abar,  # 60% in the middle
        lambda num_steps: 1 - (torch.arange(num_steps) + 1) / num_steps,  # ends at 0
        lambda num_steps: torch.linspace(0.9, 0.1, num_steps),  # no beginning, no end
        lambda num_steps: torch.linspace(0.0005, 0.99, num_steps),  # the other way
        lambda num_steps: torch.full((num_steps,), 0.5),
        lambda num_steps: torch.cumprod(1 - torch.linspace(1e-4, 0.02, num_steps), 0),
    ],
}
