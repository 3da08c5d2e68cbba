import math

import numpy as np
import pytest
import torch

from dancediff.data.augment import Augmentation
from dancediff.data.choreographed import choreograph_jobs, choreographed_takes
from dancediff.data.take import DanceTake
from dancediff.data.windows import (
    GroupCut,
    WindowSampler,
    half_overlapping,
    order_changes,
    rank_left_to_right,
)
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import TCDIFFPP
from dancediff.music.energy import energy_curve


def sampler(takes, num_frames=150, *, mirror=0.0, shift=0.0, rotate=0.0, music=False, **options):
    change = Augmentation(mirror=mirror, shift=shift, rotate=rotate, music=music)
    return WindowSampler(takes, GroupCut(num_frames), augment=change, **options)


@pytest.fixture(scope="module")
def takes():
    return [t for s in range(2) for t in choreographed_takes(s, seconds=7.0, sizes=(1, 2, 4))]


def test_windows_are_ranked_at_their_own_first_frame(takes):
    windows = sampler(takes, dancers_per_batch=8)
    for step in range(12):
        x_0, M, S, *_ = windows.batch(step)
        assert x_0.shape[2:] == (150, 151) and M.shape[1:] == (150, 35)
        assert x_0.shape[0] == max(1, 8 // x_0.shape[1])
        assert (x_0[:, :, 0, 4].diff(dim=1) > 0).all()
        ends = x_0[:, :, -1, 4].gather(1, S)
        assert (ends.diff(dim=1) >= 0).all()  # S names them left to right at the end


def test_order_uses_the_first_frame():
    """The released code sorts by the last frame under a comment that says the first."""
    x = torch.zeros(3, 5, 151)
    x[:, 0, 4] = torch.tensor([2.0, 0.0, 1.0])
    x[:, -1, 4] = torch.tensor([0.0, 1.0, 2.0])
    ranked, S = rank_left_to_right(x)
    assert ranked[:, 0, 4].tolist() == [0, 1, 2] and S.tolist() == [2, 0, 1]


def test_music_and_motion_stay_together():
    f = torch.arange(400.0)
    take = DanceTake("a", f[None, :, None].repeat(2, 1, 151), M=f[:, None].repeat(1, 35))
    x_0, M, *_ = sampler([take]).batch(3)
    assert torch.equal(x_0[:, 0, :, 0], M[:, :, 0])


def test_a_batch_follows_from_seed_and_step(takes):
    a, b = sampler(takes, seed=1), sampler(takes, seed=2)
    assert torch.equal(a.batch(7)[0], sampler(takes, seed=1).batch(7)[0])
    same = [np.array_equal(a.batch(k)[0].numpy(), b.batch(k)[0].numpy()) for k in range(5)]
    assert not all(same)


def test_a_take_follows_from_its_seed():
    a, b = (choreographed_takes(5, seconds=6.0, sizes=(2,))[0] for _ in range(2))
    assert torch.equal(a.x, b.x) and torch.equal(a.M, b.M)


def test_takes_of_different_songs_share_nothing():
    """Splits are by song seed: no dance of one seed is a dance of another."""
    a = choreographed_takes(0, seconds=6.0, sizes=(1,))[0]
    b = choreographed_takes(1, seconds=6.0, sizes=(1,))[0]
    assert a.name != b.name
    assert (a.x[0][:, None, 7:] - b.x[0][None, :, 7:]).abs().amax(-1).min() > 1e-3


def test_short_takes_are_named():
    with pytest.raises(ValueError, match="tiny"):
        sampler([DanceTake("tiny", torch.zeros(1, 100, 151), M=torch.zeros(100, 35))])
    with pytest.raises(ValueError, match="no takes"):
        sampler([])
    tiny = DanceTake("tiny", torch.zeros(1, 100, 151))
    with pytest.raises(ValueError, match=r"shorter than num_frames=150: \['tiny'\].* 100; leave"):
        half_overlapping(tiny, GroupCut(150))  # for statistics, which are fitted first


def test_every_group_size_gets_about_the_same_work(takes):
    windows = sampler(takes, dancers_per_batch=8)
    shapes = {windows.batch(k)[0].shape[:2] for k in range(20)}
    assert shapes == {(8, 1), (4, 2), (2, 4)}


def test_windows_reach_both_ends_of_a_take():
    f = torch.arange(152.0)
    take = DanceTake("a", f[None, :, None].repeat(1, 1, 151), M=f[:, None].repeat(1, 35))
    windows = sampler([take], dancers_per_batch=1)
    starts = {windows.batch(k)[1][0, 0, 0].item() for k in range(60)}
    assert starts == {0.0, 1.0, 2.0}


def test_mirrored_windows_are_ranked_in_the_mirror(takes):
    plain = sampler(takes, dancers_per_batch=8)
    always = sampler(takes, dancers_per_batch=8, mirror=1.0)
    half = sampler(takes, dancers_per_batch=8, mirror=0.5)
    before = [take.x.clone() for take in takes]
    swapped = 0
    for step in range(8):
        (x, *_), (y, _, S, *_) = plain.batch(step), always.batch(step)
        assert (y[:, :, 0, 4].diff(dim=1) > 0).all()
        assert (y[:, :, -1, 4].gather(1, S).diff(dim=1) >= 0).all()
        a, b = half.batch(step)[0][0], x[0]  # the first window is the same cut in all three
        mirrored = mirror_features(b).flip(0)
        assert torch.equal(y[0], mirrored)
        assert torch.equal(a, b) or torch.equal(a, mirrored)
        swapped += torch.equal(a, mirrored)
    assert 0 < swapped < 8
    assert all(torch.equal(take.x, x) for take, x in zip(takes, before, strict=True))


def test_shift_moves_the_group_as_one_and_never_lifts_it(takes):
    x = sampler(takes).batch(3)[0][0]
    y = sampler(takes, shift=0.5).batch(3)[0][0]
    moved = y - x
    offset = moved[0, 0, 4:7]
    assert torch.allclose(moved[..., 4:7], offset.expand_as(moved[..., 4:7]), atol=1e-6)
    assert offset[1] == 0 and 0 < offset.abs().max() <= 0.5
    assert torch.equal(x[..., 7:], y[..., 7:]) and torch.equal(x[..., :4], y[..., :4])


@pytest.mark.parametrize(("name", "value"), [("mirror", 1.5), ("shift", -1.0)])
def test_wrong_augmentation_is_named(takes, name, value):
    with pytest.raises(ValueError, match=f"{name}={value}"):
        sampler(takes, **{name: value})


def test_windows_of_the_two_sides_share_no_frame():
    """What leakage would look like: a validation window that training has seen."""
    takes = [job.make() for job in choreograph_jobs(6, seconds=6.0, sizes=(1,), share=0.4)]
    train, val = ([t for t in takes if t.split == side] for side in ("train", "val"))
    assert train and val
    seen = torch.cat([t.x[0, :, 7:] for t in train])
    for take in val:
        assert torch.cdist(take.x[0, :, 7:], seen).min() > 0.01


def test_real_takes_have_the_share_that_was_asked_for():
    takes = [
        DanceTake(
            f"{kind}{k}",
            torch.full((2, 20, 151), float(kind == "real")),
            kind,
            M=torch.zeros(20, 35),
        )
        for kind, count in (("real", 1), ("composed", 1), ("synthetic", 18))
        for k in range(count)
    ]
    for share, expected in ((0.0, 0.0), (0.5, 0.25), (None, 0.05), (1.0, 0.5)):
        windows = sampler(takes, num_frames=10, dancers_per_batch=40, real=share)
        real = torch.cat([windows.batch(step)[0] for step in range(40)]).mean()
        assert float(real) == pytest.approx(expected, abs=0.06)
    with pytest.raises(ValueError, match=r"real=1\.5"):
        sampler(takes, num_frames=10, real=1.5)


def test_a_group_size_without_real_takes_uses_what_there_is():
    takes = [DanceTake("made", torch.ones(1, 20, 151), M=torch.zeros(20, 35))]
    x, *_ = sampler(takes, num_frames=10, real=1.0).batch(0)
    assert torch.equal(x, torch.ones_like(x))


def crossing(n, changes, frames=20):
    """Takes of n dancers in a row; those in ``changes`` are in that order in the second half."""
    takes = []
    for k, order in enumerate(changes):
        x = torch.zeros(n, frames, 151)
        x[:, :, 4] = torch.arange(float(n))[:, None]
        x[list(order), frames // 2 :, 4] = torch.arange(float(n))[:, None]
        takes.append(DanceTake(str(k), x, M=torch.zeros(frames, 35)))
    return takes


def test_every_change_of_order_is_shown_as_often_as_any_other():
    """Nine takes exchange the outer two, one goes round: both are drawn alike."""
    takes = crossing(3, [(0, 1, 2)] * 40 + [(2, 1, 0)] * 9 + [(1, 2, 0)])
    for share in (0.0, 0.6):
        windows = sampler(takes, num_frames=20, dancers_per_batch=60, swaps=share)
        S = torch.cat([windows.batch(step)[2] for step in range(60)])
        outer, around = (
            (S == torch.tensor(order)).all(1).float().mean() for order in ((2, 1, 0), (1, 2, 0))
        )
        assert outer == pytest.approx(0.18 + share * (0.5 - 0.18), abs=0.06)
        assert around == pytest.approx(0.02 + share * (0.5 - 0.02), abs=0.06)


def test_a_size_that_never_changes_order_is_drawn_as_it_falls():
    takes = crossing(2, [(0, 1)] * 3)
    x, _, S, *_ = sampler(takes, num_frames=10, swaps=1.0).batch(0)
    assert (S == torch.arange(2)).all() and len(x) == 12
    with pytest.raises(ValueError, match=r"swaps=1\.5"):
        sampler(takes, num_frames=10, swaps=1.5)


def test_order_changes_are_those_of_the_ranked_windows():
    take = choreographed_takes(2, seconds=16.0, sizes=(3,))[0]
    found = order_changes([take], 150, every=10)
    assert sum(map(len, found)) > 0
    listed = {int(start) for places in found for _, start in places}
    for start in range(0, take.x.shape[1] - 149, 10):
        _, S = rank_left_to_right(take.x[:, start : start + 150])
        assert (S.tolist() != [0, 1, 2]) == (start in listed)


def styled_takes():
    """Songs that grow louder, each in its own way, so that a piece of energy tells its place."""
    takes = []
    for k, (kind, genre) in enumerate([("real", "salsa"), ("synthetic", "hiphop"), ("real", None)]):
        M = torch.zeros(3, 90, 35)
        M[..., 1] = torch.linspace(-100 - 20 * k, 0, 90) * torch.tensor([1.0, 2.0, 3.0])[:, None]
        x = torch.full((2, 90, 151), float(k))
        takes.append(DanceTake(f"t{k}", x, kind, M=M[0], M_other=M[1:], genre=genre))
    return takes


def test_windows_know_their_genre_and_the_energy_of_their_song():
    takes, names = styled_takes(), ("hiphop", "salsa", "waltz")
    curves = [energy_curve(M) for take in takes for M in take.songs]
    change = Augmentation(music=True, any_song=0.5)
    style = {"genres": names, "energy": True}
    windows = WindowSampler(takes, GroupCut(30), **style, augment=change, dancers_per_batch=8)
    of_take = [(0.0, 1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 0.0)]
    songs, genres = set(), set()
    for step in range(30):
        batch = windows.batch(step)
        assert batch.genre.shape == (4, 3) and batch.energy.shape == (4, 30)
        rows = zip(batch.x, batch.M, batch.genre, batch.energy, strict=True)
        for x, M, genre, energy in rows:
            assert tuple(genre.tolist()) == of_take[round(x[0, 0, 0].item())]
            found = [
                (k, start)
                for k, song in enumerate(M for take in takes for M in take.songs)
                for start in range(61)
                if torch.equal(song[start : start + 30], M)
            ]
            assert any(torch.equal(curves[k][s : s + 30], energy) for k, s in found)
            songs.add(found[0][0])
            genres.add(tuple(genre.tolist()))
    assert songs == set(range(9))
    assert genres == set(of_take)
    plain = WindowSampler(takes, GroupCut(30)).batch(0)
    assert plain.genre is None and plain.energy is None


def test_windows_are_turned_by_at_most_the_angle(takes):
    plain, turned = (sampler(takes, rotate=angle).batch(3) for angle in (0.0, 0.5))
    assert not torch.equal(plain.x, turned.x)
    lateral = turned.x[:, :, 0, TCDIFFPP.lateral]
    assert (lateral.diff(dim=1) >= 0).all(), "ranked after the turn"
    x, rng = plain.x[0], np.random.default_rng(0)
    for _ in range(20):
        y = Augmentation(rotate=0.5).motion(x, rng)
        (a, b), (c, d) = (one[0, 0, TCDIFFPP.floor].tolist() for one in (x, y))
        angle = (math.atan2(b, a) - math.atan2(d, c) + math.pi) % (2 * math.pi) - math.pi
        assert 0 < abs(angle) <= 0.5 and math.hypot(a, b) == pytest.approx(math.hypot(c, d))
    with pytest.raises(ValueError, match="rotate=4"):
        sampler(takes, rotate=4.0)
