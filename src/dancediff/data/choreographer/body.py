r"""From footsteps and key poses to a moving body.

Pelvis over the feet, bouncing with the beat; legs by two-bone IK, so a planted foot stays put;
torso and arms ease from key pose to key pose and arrive on the beat.

Symbols (axes: f frames · k keys)
    beat   position of each frame on the beat grid            (f,)
    pose   joint rotations relative to the parent             (f, 24, 3, 3)
    root   pelvis position, metres                            (f, 3)
"""

from dataclasses import dataclass

import numpy as np
import roma
import torch
from scipy.ndimage import gaussian_filter1d, maximum_filter1d
from torch import Tensor

from dancediff.data.choreographer.footsteps import FootPath, smoothstep
from dancediff.data.choreographer.vocabulary import ARM_POSES
from dancediff.motion.ik import two_bone_ik
from dancediff.motion.rotation import rotation_about, rotation_between
from dancediff.motion.skeleton import SMPL24

_OFFSETS = SMPL24.offsets
_LEGS = ((1, 4, 7, 10), (2, 5, 8, 11))  # hip, knee, ankle, toe of the left and the right leg
_TORSO = {"belly": 0.35, "spine": 0.30, "chest": 0.35}  # share of a torso bend in each joint
_REACH = 0.995  # of the leg's length; a straighter leg pops at the knee


@dataclass(frozen=True)
class Groove:
    """How one dancer carries the dance: small personal differences within a group."""

    height: float = 0.915  # metres, pelvis when standing in the groove
    bounce: float = 0.045  # metres down on every beat
    sway: float = 0.35  # share of the weight that goes over the standing foot
    size: float = 1.0  # of torso bends
    arms: float = 0.0  # metres-free spread of arm directions

    @classmethod
    def draw(cls, rng: np.random.Generator) -> "Groove":
        """A dancer's own groove."""
        return cls(
            height=0.915 + rng.uniform(-0.008, 0.008),
            bounce=0.045 * rng.uniform(0.8, 1.2),
            size=rng.uniform(0.85, 1.15),
            arms=rng.uniform(-0.06, 0.06),
        )


def tensor(x) -> Tensor:
    """Float32 tensor of anything."""
    return torch.as_tensor(np.asarray(x), dtype=torch.float32)


def pelvis_path(beat, feet: tuple[FootPath, FootPath], groove: Groove, frames_per_beat: float):
    """Pelvis position in every frame: over the planted feet, as high as the legs allow, (f, 3)."""
    weight = np.stack([foot.planted for foot in feet], -1).astype(float)
    weight = 1 - groove.sway + groove.sway * weight
    weight /= weight.sum(-1, keepdims=True)
    floor = sum(w[:, None] * foot.ankle[:, (0, 2)] for w, foot in zip(weight.T, feet, strict=True))
    floor = gaussian_filter1d(floor, 0.32 * frames_per_beat, axis=0, mode="nearest")
    wanted = groove.height - groove.bounce * 0.5 * (1 + np.cos(2 * np.pi * beat))
    # hips sit about 9 cm below and 6 cm beside the pelvis; legs must reach every foot
    room = np.full(len(beat), np.inf)
    for side, (hip, knee, ankle, _), foot in zip((1, -1), _LEGS, feet, strict=True):
        leg = _REACH * (_OFFSETS[knee].norm() + _OFFSETS[ankle].norm()).item()
        away = floor + np.array([0.06 * side, -0.015]) - foot.ankle[:, (0, 2)]
        drop = np.sqrt(np.maximum(leg**2 - (away**2).sum(-1), 0.05))
        room = np.minimum(room, foot.ankle[:, 1] + drop - _OFFSETS[hip, 1].item() - 0.012)
    excess = np.maximum(wanted - room, 0)
    width = max(3, round(0.6 * frames_per_beat))
    lower = gaussian_filter1d(maximum_filter1d(excess, width), width / 4, mode="nearest")
    height = wanted - np.maximum(lower, excess)
    return np.stack([floor[:, 0], height, floor[:, 1]], -1)


def ease_keys(keys: Tensor, beat: np.ndarray) -> Tensor:
    """Rotations (k, j, 3, 3), key k reached on beat k, -> (f, j, 3, 3), eased in between."""
    last = len(keys) - 1
    index = np.clip(np.floor(beat).astype(int), 0, last - 1)
    # wait a little on the pose, then go and arrive on the beat: that is what makes a beat visible
    u = smoothstep((beat - index - 0.12) / 0.88)
    q = roma.rotmat_to_unitquat(keys)
    steps = tensor(u)[:, None].expand(-1, keys.shape[1])
    a, b = q[index], q[index + 1]
    b = torch.where((a * b).sum(-1, keepdim=True) < 0, -b, b)  # the shorter way round
    mixed = torch.nn.functional.normalize(
        torch.lerp(a, b, steps[..., None]), dim=-1
    )  # nlerp: keys are at most a right angle or so apart
    return roma.unitquat_to_rotmat(mixed)


def arm_rotations(poses: list[str], side: int, spread: float) -> Tensor:
    """Shoulder and elbow rotations for arm poses, (k, 2, 3, 3); side +1 left, -1 right."""
    flip = torch.tensor([float(side), 1.0, 1.0])
    upper = torch.stack([tensor(ARM_POSES[p][0]) for p in poses]) + spread
    fore = torch.stack([tensor(ARM_POSES[p][1]) for p in poses]) + spread
    elbow, wrist = (18, 20) if side > 0 else (19, 21)
    shoulder = rotation_between(_OFFSETS[elbow].expand_as(upper), upper * flip)
    in_arm = (shoulder.mT @ (fore * flip)[..., None])[..., 0]
    return torch.stack([shoulder, rotation_between(_OFFSETS[wrist].expand_as(fore), in_arm)], dim=1)


def torso_rotations(torso: np.ndarray, size: float) -> Tensor:
    """Belly, spine, chest, neck and head rotations for torso keys in degrees, (k, 5, 3, 3)."""
    pitch, bend, twist = (tensor(np.radians(torso[:, i]) * size) for i in range(3))

    def turn(share: float) -> Tensor:
        return (
            rotation_about("y", twist * share)
            @ rotation_about("z", -bend * share)
            @ rotation_about("x", pitch * share)
        )

    # the head half undoes what the torso does: dancers look at the audience
    return torch.stack([turn(s) for s in (*_TORSO.values(), -0.35, -0.35)], dim=1)


def assemble(beat, yaw, feet, keys: Tensor, groove: Groove, frames_per_beat: float):
    """Whole-body rotations and root path of one dancer.

    Shapes: beat, yaw (f,); keys (k, 9, 3, 3): torso 5, left shoulder and elbow, right shoulder and
    elbow, one row per beat -> pose (f, 24, 3, 3), root (f, 3).
    """
    f = len(beat)
    root = tensor(pelvis_path(beat, feet, groove, frames_per_beat))
    pose = torch.eye(3).repeat(f, 24, 1, 1)
    eased = ease_keys(keys, beat)
    for place, name in enumerate(("belly", "spine", "chest", "neck", "head")):
        pose[:, SMPL24.index(name)] = eased[:, place]
    for place, name in enumerate(("lshoulder", "lelbow", "rshoulder", "relbow"), start=5):
        pose[:, SMPL24.index(name)] = eased[:, place]
    # hips answer the shoulders: a third of the torso's twist, the other way round
    twist = roma.rotmat_to_rotvec(eased[:, 0])[:, 1]
    facing = rotation_about("y", tensor(yaw) - 0.6 * twist)
    pose[:, 0] = facing
    for foot, (hip, knee, ankle, _) in zip(feet, _LEGS, strict=True):
        hip_at = root + facing @ _OFFSETS[hip]
        out = rotation_about("y", tensor(foot.yaw))
        pole = out @ torch.tensor([0.0, 0.0, 1.0])
        thigh, shin, _ = two_bone_ik(
            hip_at, tensor(foot.ankle), pole, _OFFSETS[knee], _OFFSETS[ankle]
        )
        sole = out @ rotation_about("x", tensor(foot.pitch))
        pose[:, hip] = facing.mT @ thigh
        pose[:, knee] = thigh.mT @ shin
        pose[:, ankle] = shin.mT @ sole
    return pose, root
