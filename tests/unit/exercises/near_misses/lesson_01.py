"""Plausible wrong answers to the exercises of lesson 01: A dance is a tensor."""

import torch

from dancediff.motion.rotation import (
    axis_angle_to_matrix,
    matrix_to_axis_angle,
    matrix_to_rot6d,
    rot6d_to_matrix,
    rotation_about,
    slerp,
)
from dancediff.motion.skeleton import world_rotations


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


def moments(f, old, new):
    """Where new frames lie, in old frames."""
    return torch.arange((f - 1) * new // old + 1) * old / new


def at_rate(*, when=moments, mix=slerp, contact=lambda a, b, w: a, root=torch.lerp, share=None):
    """A dance at another rate, with one part replaced; with none it is right."""

    def answer(x, old, new):
        at = when(x.shape[1], old, new)
        k = at.floor().long()
        w = (at - k if share is None else share(at - k))[:, None]
        a, b = x[:, k], x[:, (k + 1).clamp(max=x.shape[1] - 1)]
        R = [rot6d_to_matrix(y[..., 7:].unflatten(-1, (24, 6))) for y in (a, b)]
        d6 = matrix_to_rot6d(mix(*R, w)).flatten(-2)
        parts = contact(a[..., :4], b[..., :4], w), root(a[..., 4:7], b[..., 4:7], w), d6
        return torch.cat(parts, dim=-1)

    return answer


def by_vectors(R, S, w):
    return axis_angle_to_matrix(torch.lerp(*map(matrix_to_axis_angle, (R, S)), w[..., None]))


def pulled_straight(R, S, w):
    return rot6d_to_matrix(torch.lerp(*map(matrix_to_rot6d, (R, S)), w[..., None]))


def in_the_world(R, S, w):
    return axis_angle_to_matrix(w[..., None] * matrix_to_axis_angle(R.mT @ S)) @ R


def as_numbers(x, old, new):
    """Every number on a line, rotations as well."""
    at = moments(x.shape[1], old, new)
    k = at.floor().long()
    return torch.lerp(x[:, k], x[:, (k + 1).clamp(max=x.shape[1] - 1)], (at - k)[:, None])


NEAR_MISSES = {
    "01.1": [
        {"18 left elbow": 3, "22 left hand": 1, "9 chest": 13, "0 root": 24},  # the joint itself
        {"18 left elbow": 2, "22 left hand": 0, "9 chest": 3, "0 root": 3},  # children only
        {"18 left elbow": 2, "22 left hand": 0, "9 chest": 12, "0 root": 0},
        {"18 left elbow": 21, "22 left hand": 23, "9 chest": 11, "0 root": 0},  # what stays
    ],
    "01.2": [
        arm_up(lambda pose: quarter()),  # leans with the body
        arm_up(lambda pose: quarter() @ world_rotations(pose)[13].mT),  # the wrong way round
        arm_up(lambda pose: world_rotations(pose)[16].mT @ quarter()),  # minds its own turn, too
        arm_up(lambda pose: world_rotations(pose)[13].mT @ quarter(-1)),  # down
        arm_up(lambda pose: world_rotations(pose)[13].mT @ quarter(), straight=False),
        arm_up(lambda pose: world_rotations(pose)[13] @ quarter()),  # no inverse
        arm_up(lambda pose: torch.zeros(3, 3)),
        stand_up_first,
        lambda pose: pose,
        lambda pose: quarter().expand(24, 3, 3).clone(),  # all joints
        arm_up(lambda pose: 1.2 * world_rotations(pose)[13].mT @ quarter()),  # longer bones
    ],
    "01.3": [
        six_as_columns,
        six_not_squared,
        six_left_handed,
        six_changes_nothing,
        lambda d6: rot6d_to_matrix(d6.flip(-1)),  # the rows exchanged, and backwards
        lambda d6: rot6d_to_matrix(d6.unflatten(-1, (3, 2)).transpose(-1, -2).flatten(-2)),
        lambda d6: rot6d_to_matrix(d6)[..., :2, :],  # no third row
    ],
    "01.4": [
        lambda: ([1.0, 0, 0, 0, 1, 0], [1.0, 0, 0, 0, 1.01, 0]),  # rows at right angles
        lambda: ([1.0, 0, 0, 1, 0, 0], [1.0, 0, 0, 1, 0.01, 0]),  # parallel
        lambda: ([1.0, 0, 0, 0, 0.004, 0], [1.0, 0, 0, 0, -0.004, 0]),  # too short
        lambda: ([1.0, 0, 0, 1, 0.1, 0], [1.0, 0, 0, 1, -0.1, 0]),  # too far apart
        lambda: ([1.0, 0, 0, 0, 1, 0], [-1.0, 0, 0, 0, 1, 0]),
        lambda: [1.0, 0, 0, 1, 0.004, 0],  # one only
    ],
    "01.5": [
        as_numbers,  # bones shrink between frames
        at_rate(mix=pulled_straight),  # not evenly fast
        at_rate(mix=by_vectors),  # jumps at half a turn
        at_rate(mix=in_the_world),  # the turn stands on the wrong side
        at_rate(mix=lambda R, S, w: slerp(S, R, w)),  # from behind
        at_rate(mix=lambda R, S, w: R),  # rotations of the frame before
        at_rate(mix=lambda R, S, w: R @ slerp(R, S, w)),  # the turn once more
        at_rate(mix=lambda R, S, w: slerp(R.mT, S.mT, w)),  # columns
        at_rate(contact=torch.lerp),  # half a contact
        at_rate(contact=lambda a, b, w: torch.where(w < 0.5, a, b)),  # of the nearest frame
        at_rate(root=lambda a, b, w: a),
        at_rate(share=torch.round),  # the nearest frame
        at_rate(share=lambda w: 1 - w),
        at_rate(when=lambda f, old, new: moments(f, new, old)),  # the other way round
        at_rate(when=lambda f, old, new: moments(f, old, new)[:-1]),  # without the last
        at_rate(when=lambda f, old, new: torch.arange(f * new // old) * old / new),
        at_rate(when=lambda f, old, new: torch.arange(0, f, max(1, old // new)).float()),
        at_rate(  # stretched, so that both ends are met
            when=lambda f, old, new: torch.linspace(0, f - 1, len(moments(f, old, new)))
        ),
    ],
}
