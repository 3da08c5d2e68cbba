import pytest
import torch

from dancediff.extensions.root_stitching import root_stitching
from dancediff.papers.lodge.primitives import Layout
from dancediff.papers.lodge.segments import segments_of

X, Y, Z = 4, 5, 6


def walkers(L=4, n=64, seed=0):
    """Locals that each start near the middle and walk somewhere, smoothly."""
    g = torch.Generator().manual_seed(seed)
    x = torch.randn(L, n, 139, generator=g)
    time = torch.linspace(0, 1, n)[:, None]
    for axis in (X, Y, Z):
        a, b, c = torch.randn(3, L, generator=g) * 0.3
        x[..., axis] = (a + b * time + c * time**2).T
    x[..., Y] = 0.9 + 0.1 * x[..., Y]
    return x


def test_every_length_is_covered_once():
    for frames in (1, 255, 256, 257, 1023, 1024, 1025, 2048, 2100, 8192):
        p = segments_of(frames)
        L = len(p.locals)
        assert (L - 1) * 256 < frames <= L * 256
        assert p.locals == tuple(256 * j for j in range(L)) and p.seams == list(p.locals[1:])
        new = [start // 256 + s for start, s in zip(p.globals, p.shared, strict=True)]
        ends = [start // 256 + 4 for start in p.globals]
        assert new[0] == 0 and new[1:] == ends[:-1]  # each goes on where the one before stopped
        assert len(p.globals) == -(-L // 4) and (ends[-1] == L or L < 4)


def test_music_of_segments_is_cut_where_they_are():
    M = torch.arange(2100.0)[:, None]
    p = segments_of(2100)
    assert p.global_music(M).shape == (3, 1024, 1) and p.local_music(M).shape == (9, 256, 1)
    assert p.global_music(M)[:, 0, 0].tolist() == [0, 1024, 1280]
    assert p.local_music(M)[8, :53, 0].tolist() == [*range(2048, 2100), 0]  # over again
    assert segments_of(300).global_music(M[:300])[0, [299, 300, 1023], 0].tolist() == [299, 0, 123]
    assert segments_of(300).global_music(M)[0, 300, 0] == 300  # a dance shorter than its song
    with pytest.raises(ValueError, match="M has 100 frames, the dance 2100"):
        p.local_music(M[:100])
    with pytest.raises(ValueError, match="frames=0"):
        segments_of(0)


def test_other_layouts():
    p = segments_of(1200, Layout(512, 128))
    assert p.globals == (0, 512, 768) and p.shared == [0, 0, 2]
    assert len(p.locals) == 10


@pytest.mark.parametrize("blend", [0, 1, 8, 32])
def test_the_root_goes_on_at_the_seam_with_the_mean_of_both_velocities(blend):
    x = walkers()
    y = root_stitching(x, blend=blend)
    assert y.shape == (256, 139)
    for s in (64, 128, 192):
        j = s // 64
        for axis in (X, Z):
            before = x[j - 1, -1, axis] - x[j - 1, -2, axis]
            after = x[j, 1, axis] - x[j, 0, axis]
            assert torch.isclose(y[s, axis] - y[s - 1, axis], (before + after) / 2, atol=1e-5)


def test_velocity_changes_little_anywhere():
    x = walkers()
    rough, smooth = (root_stitching(x, blend=b)[:, [X, Z]].diff(dim=0).diff(dim=0) for b in (0, 16))
    assert smooth.abs().max() < 0.3 * rough.abs().max()


def test_away_from_seams_everybody_walks_as_before():
    x, n, B = walkers(), 64, 8
    y = root_stitching(x, blend=B).view(4, n, 139)
    inner = slice(B, n - B)
    for axis in (X, Z):
        steps = y[:, inner, axis].diff(dim=1)
        assert torch.allclose(steps, x[:, inner, axis].diff(dim=1), atol=1e-5)
    assert torch.allclose(y[:, inner, Y], x[:, inner, Y], atol=1e-6)
    rest = [c for c in range(139) if c not in (X, Y, Z)]
    assert torch.equal(y[..., rest], x[..., rest])


def test_heights_meet_and_do_not_drift():
    x = walkers(L=50)
    y = root_stitching(x, blend=8)
    assert y[:, Y].diff().abs().max() < 0.04 < (x[1:, 0, Y] - x[:-1, -1, Y]).abs().max()
    assert (y[:, Y] - x.flatten(0, 1)[:, Y]).abs().max() < 0.3  # no local is lifted as a whole
    assert torch.equal(root_stitching(x, blend=0)[:, Y], x.flatten(0, 1)[:, Y])


def test_one_local_and_bad_arguments():
    x = walkers(L=1)
    assert torch.allclose(root_stitching(x), x[0], atol=1e-6)
    with pytest.raises(ValueError, match="blend=33"):
        root_stitching(x, blend=33)
    with pytest.raises(ValueError, match="one frame"):
        root_stitching(torch.zeros(2, 1, 139), blend=0)


def test_the_source_is_left_alone():
    x = walkers()
    before = x.clone()
    root_stitching(x)
    assert torch.equal(x, before)
