"""Forward kinematics of any tree and any dance: bones are rigid, frames do not meet."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dancediff.motion.mirror import mirror_features
from dancediff.motion.motion import Motion
from dancediff.motion.representation import LODGE, TCDIFFPP, joints_of, pack, unpack
from dancediff.motion.rotation import rot6d_to_matrix, rotation_about
from dancediff.motion.skeleton import SMPL24, Skeleton, forward_kinematics, world_rotations

often = settings(deadline=None, derandomize=True, max_examples=50)
seeds = st.integers(0, 2**32 - 1)
frames = st.integers(1, 12)


def other_side(name):
    swapped = {"l": "r", "r": "l"}.get(name[0], name[0]) + name[1:]
    return swapped if swapped in SMPL24.names else name


LEFT_RIGHT = [SMPL24.index(other_side(name)) for name in SMPL24.names]


def normal(seed, *shape):
    generator = torch.Generator().manual_seed(seed)
    return torch.randn(shape, generator=generator, dtype=torch.float64)


def dance(seed, f, joints=24, n=2):
    """Joint rotations (n, f, j, 3, 3) and a path of the root (n, f, 3)."""
    return rot6d_to_matrix(normal(seed, n, f, joints, 6)), normal(seed + 1, n, f, 3)


def tree(seed, joints):
    """Any joints on any others, each numbered after the one it hangs on."""
    generator = torch.Generator().manual_seed(seed)
    parents = [-1] + [int(torch.randint(j, (), generator=generator)) for j in range(1, joints)]
    names = tuple(map(str, range(joints)))
    return Skeleton(names, tuple(parents), normal(seed + 2, joints, 3))


def close(a, b):
    torch.testing.assert_close(a, b, atol=1e-9, rtol=0)


@often
@given(seeds, frames, st.integers(1, 30))
def test_bones_keep_their_length(seed, f, count):
    skeleton = tree(seed, count)
    joints = forward_kinematics(*dance(seed, f, count), skeleton)
    for a, b in skeleton.bones:
        length = (joints[..., b, :] - joints[..., a, :]).norm(dim=-1)
        close(length, skeleton.offsets[b].norm().expand_as(length))


@often
@given(seeds, frames)
def test_the_roots_path_moves_all_joints_alike(seed, f):
    pose, root = dance(seed, f)
    by = normal(seed + 3, 2, f, 3)
    moved = forward_kinematics(pose, root + by) - forward_kinematics(pose, root)
    close(moved, by[..., None, :].expand_as(moved))


@often
@given(seeds, frames, st.floats(-7, 7))
def test_who_turns_about_the_vertical_turns_all_joints_alike(seed, f, angle):
    pose, root = dance(seed, f)
    turn = rotation_about("y", torch.tensor(angle, dtype=torch.float64))
    turned = torch.cat([turn @ pose[:, :, :1], pose[:, :, 1:]], 2)
    joints = forward_kinematics(turned, root @ turn.T)
    close(joints, forward_kinematics(pose, root) @ turn.T)
    close(joints[..., 1], forward_kinematics(pose, root)[..., 1])  # nobody rises or sinks


@often
@given(seeds, frames, st.data())
def test_a_frame_alone_is_the_frame_of_the_dance(seed, f, data):
    pose, root = dance(seed, f)
    k = data.draw(st.integers(0, f - 1))
    alone = forward_kinematics(pose[:, k], root[:, k])
    close(alone, forward_kinematics(pose, root)[:, k])
    close(world_rotations(pose[:, k]), world_rotations(pose)[:, k])


@often
@given(seeds, st.integers(2, 30), st.data())
def test_a_joint_moves_only_what_hangs_on_it(seed, count, data):
    skeleton, (pose, root) = tree(seed, count), dance(seed, 3, count)
    j = data.draw(st.integers(0, count - 1))
    other = pose.clone()
    other[:, :, j] = dance(seed + 5, 3, 1)[0][:, :, 0]
    hangs = {j}
    for k in range(count):  # children have larger numbers than parents
        if skeleton.parents[k] in hangs:
            hangs.add(k)
    before, after = (forward_kinematics(p, root, skeleton) for p in (pose, other))
    for k in range(count):
        if k == j or k not in hangs:
            close(after[..., k, :], before[..., k, :])
        else:
            assert not torch.equal(after[..., k, :], before[..., k, :])


@often
@given(seeds, frames, st.sampled_from([TCDIFFPP, LODGE]))
def test_mirrored_features_are_the_mirrored_body(seed, f, spec):
    # SMPL-24 is not quite symmetric, so the body is made so first
    D = torch.tensor([-1.0, 1.0, 1.0], dtype=torch.float64)
    offsets = SMPL24.offsets.double()
    even = Skeleton(SMPL24.names, SMPL24.parents, (offsets + D * offsets[LEFT_RIGHT]) / 2)
    pose, root = dance(seed, f)
    x = pack(normal(seed + 4, 2, f, 4), root, pose[:, :, : spec.num_joints])

    def joints(x):
        _, root, pose = unpack(x, spec)
        hands = torch.eye(3, dtype=torch.float64).expand(*pose.shape[:2], 24, 3, 3).clone()
        hands[:, :, : spec.num_joints] = pose
        return forward_kinematics(hands, root, even)

    close(joints(mirror_features(x, spec)), (joints(x) * D)[..., LEFT_RIGHT, :])


@often
@given(seeds, frames, st.integers(1, 5), st.sampled_from([TCDIFFPP, LODGE]))
def test_features_and_back(seed, f, n, spec):
    pose, root = dance(seed, f, n=n)
    motion = Motion(pose, root)
    x = motion.features(spec.name)
    assert x.shape == (n, f, spec.dim)
    again = Motion.from_features(x, name=spec.name)
    torch.testing.assert_close(again.joints(), motion.joints(), atol=1e-5, rtol=0)
    torch.testing.assert_close(joints_of(x, spec), motion.joints(), atol=1e-5, rtol=0)
    torch.testing.assert_close(again.features(spec.name), x, atol=1e-6, rtol=0)
