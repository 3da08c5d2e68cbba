import numpy as np
import pytest
import torch

from dancediff.motion.representation import LODGE
from dancediff.papers.lodge.primitives import (
    DISCRETE,
    LAYOUT,
    Layout,
    at_origin,
    beside_joins,
    primitive_frames,
    primitives_of,
    thinned_primitives,
)
from dancediff.papers.lodge.segments import segments_of


def swinging(frames=1024, period=40, f0=0, walk=0.0):
    """One arm that swings: it comes to rest every half period, for one at frame f0."""
    x = torch.zeros(frames, LODGE.dim)
    angle = torch.cos((torch.arange(frames) - f0) * 2 * torch.pi / period)
    eye = torch.tensor([1.0, 0, 0, 0, 1, 0])
    x[:, LODGE.rot6d] = eye.repeat(LODGE.num_joints)
    x[:, LODGE.joint_channels([16])[:2]] = torch.stack([angle.cos(), angle.sin()], 1)
    x[:, LODGE.joint_channels([16])[3:5]] = torch.stack([-angle.sin(), angle.cos()], 1)
    x[:, LODGE.root] = torch.arange(frames)[:, None] * walk * torch.tensor([1.0, 0, -2])
    x[:, 5] = 0.9
    return x


def test_sizes_of_the_paper():
    assert (LAYOUT.locals_per_global, LAYOUT.num_primitives, LAYOUT.num_frames) == (4, 13, 104)
    assert LAYOUT.offsets.tolist() == [-4, -3, -2, -1, 0, 1, 2, 3]
    assert Layout(256, 128).num_frames == 56  # AIST++


@pytest.mark.parametrize(
    ("sizes", "word"),
    [
        ({"global_frames": 1000}, "no multiple"),
        ({"length": 7}, "even"),
        ({"local_frames": 0}, "at least 1"),
        ({"local_frames": 32, "global_frames": 64}, "too short"),
        ({"local_frames": 128, "stride": 4}, "too short"),
    ],
)
def test_layouts_that_cannot_work_are_refused(sizes, word):
    with pytest.raises(ValueError, match=word):
        Layout(**sizes)


@pytest.mark.parametrize("stride", [1, 4])
def test_key_motions_are_where_the_body_comes_to_rest(stride):
    layout = Layout(stride=stride)
    primitives, frames = primitives_of(swinging(f0=7), layout=layout)
    middles = frames[:, 4]
    soft = [m for k, m in enumerate(middles.tolist()) if k % 3]
    assert all((m - 7) % 20 == 0 for m in soft)
    assert [sum(a <= m < a + 256 for m in soft) for a in range(0, 1024, 256)] == [2] * 4
    assert middles[::3].tolist() == [4 * stride, 256, 512, 768, 1024 - 4 * stride]
    assert (frames.diff(dim=1) == stride).all() and frames.min() == 0
    assert primitives.shape == (13, 8, 139)


def test_primitives_are_pieces_of_the_clip_and_start_at_the_origin():
    x = swinging(walk=0.01)
    primitives, frames = primitives_of(x)
    assert torch.equal(primitives[..., 7:], x[frames][..., 7:])
    assert torch.equal(primitives[..., 5], x[frames][..., 5])  # heights stay
    assert (primitives[:, 0, [4, 6]] == 0).all()
    steps = primitives[..., [4, 6]].diff(dim=1)
    assert torch.allclose(steps, torch.tensor([0.01, -0.02]).expand_as(steps), atol=1e-5)


def test_of_the_rests_in_half_a_local_the_one_with_most_movement_around_it_is_taken():
    """Lodge section 1: key motions "with high kinematic energy"."""
    x = swinging(f0=7)
    frames, channels = torch.arange(1024), LODGE.joint_channels([17])
    angle = torch.cos((frames - 7) * torch.pi / 20)
    angle[(frames < 207) | (frames > 247)] = 1.0  # the other arm swings once, too
    x[:, channels[:2]] = torch.stack([angle.cos(), angle.sin()], 1)
    x[:, channels[3:5]] = torch.stack([-angle.sin(), angle.cos()], 1)
    middles = primitives_of(x)[1][:, 4].tolist()
    assert middles[2] == 227 and (middles[1] - 7) % 20 == 0 and middles[1] < 128


def test_known_energy_is_used():
    energy = np.zeros(1024)
    energy[100] = 1.0
    assert primitives_of(swinging(), [60, 100, 150], energy=energy)[1][1:3, 4].tolist() == [
        100,
        150,
    ]
    assert primitives_of(swinging(), [60, 100, 150], energy=-energy)[1][1, 4] == 60


def test_known_beats_are_used():
    x = swinging()
    _, frames = primitives_of(x, [100, 150])
    assert frames[1:3, 4].tolist() == [100, 150]


def test_no_primitive_lies_across_a_join():
    joins = [3, 60, 100, 256, 1021]
    _, frames = primitives_of(swinging(), [60, 103], joins=joins)
    for join in joins:
        assert not ((frames[:, 0] < join) & (join <= frames[:, -1])).any()
    assert frames.min() >= 0 and frames.max() < 1024 and (frames.diff(dim=1) == 1).all()
    apart = beside_joins(frames, [])
    assert torch.equal(apart, frames)


@pytest.mark.parametrize("layout", [LAYOUT, DISCRETE, Layout(512, 128), Layout(512, 256)])
def test_no_frame_is_taken_twice(layout):
    generator = torch.Generator().manual_seed(3)
    for share in (0.0, 0.005, 0.02, 0.2, 1.0):
        beats = (torch.rand(layout.global_frames, generator=generator) < share).nonzero()[:, 0]
        # the tightest places: right after the first hard primitive, right before the last one
        close = int(1.5 * layout.span)
        beats = [close, *beats.tolist(), layout.global_frames - close]
        frames = primitive_frames(beats, layout)
        low, high = frames[:, 0], frames[:, -1]
        assert frames.min() >= 0 and frames.max() < layout.global_frames
        assert (low[1:] > high[:-1]).all()  # in order of time, and apart


def test_a_clip_of_another_length_is_refused():
    with pytest.raises(ValueError, match=r"\(1023, 139\).*1024"):
        primitives_of(torch.zeros(1023, 139))


def test_each_clip_of_a_batch_is_moved_by_itself():
    x = torch.randn(3, 5, 139)
    source = x.clone()
    y = at_origin(x)
    assert torch.equal(x, source)
    assert (y[:, 0, [4, 6]] == 0).all() and torch.equal(y[..., 7:], x[..., 7:])
    steps = y[..., LODGE.root].diff(dim=1)
    assert torch.allclose(steps, x[..., LODGE.root].diff(dim=1), atol=1e-6)


def test_primitives_of_a_thinned_dance_are_on_its_beats():
    x = swinging(256, f0=7)  # at rest in frames 7, 27, 47, ...
    x[:, 0] = torch.arange(256)
    middles = thinned_primitives(x)[:, 4, 0]
    assert all((m - 7) % 20 == 0 for k, m in enumerate(middles.tolist()) if k % 3)


def test_behind_the_end_of_a_song_it_starts_again():
    M = torch.arange(300.0)[:, None]
    segments = segments_of(300)
    assert torch.equal(segments.local_music(M).flatten(), torch.arange(512.0) % 300)
    assert torch.equal(segments.global_music(M).flatten(), torch.arange(1024.0) % 300)
