import numpy as np
import pytest
import torch

from dancediff.data import windows as module
from dancediff.data.windows import (
    GroupDanceWindows,
    Take,
    choreographed_corpus,
    choreographed_takes,
    rank_left_to_right,
    split_takes,
)
from dancediff.motion.mirror import mirror_features


@pytest.fixture(scope="module")
def takes():
    return [t for s in range(2) for t in choreographed_takes(s, seconds=7.0, sizes=(1, 2, 4))]


def test_windows_are_ranked_at_their_own_first_frame(takes):
    windows = GroupDanceWindows(takes, dancers_per_batch=8)
    for step in range(12):
        x_0, M, S = windows.batch(step)
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
    take = Take("a", f[None, :, None].repeat(2, 1, 151), f[:, None].repeat(1, 35))
    x_0, M, _ = GroupDanceWindows([take]).batch(3)
    assert torch.equal(x_0[:, 0, :, 0], M[:, :, 0])


def test_a_batch_follows_from_seed_and_step(takes):
    a, b = GroupDanceWindows(takes, seed=1), GroupDanceWindows(takes, seed=2)
    assert torch.equal(a.batch(7)[0], GroupDanceWindows(takes, seed=1).batch(7)[0])
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
        GroupDanceWindows([Take("tiny", torch.zeros(1, 100, 151), torch.zeros(100, 35))])
    with pytest.raises(ValueError, match="no takes"):
        GroupDanceWindows([])


def test_every_group_size_gets_about_the_same_work(takes):
    windows = GroupDanceWindows(takes, dancers_per_batch=8)
    shapes = {windows.batch(k)[0].shape[:2] for k in range(20)}
    assert shapes == {(8, 1), (4, 2), (2, 4)}


def test_windows_reach_both_ends_of_a_take():
    f = torch.arange(152.0)
    take = Take("a", f[None, :, None].repeat(1, 1, 151), f[:, None].repeat(1, 35))
    windows = GroupDanceWindows([take], dancers_per_batch=1)
    starts = {windows.batch(k)[1][0, 0, 0].item() for k in range(60)}
    assert starts == {0.0, 1.0, 2.0}


def test_mirrored_windows_are_ranked_in_the_mirror(takes):
    plain = GroupDanceWindows(takes, dancers_per_batch=8)
    always = GroupDanceWindows(takes, dancers_per_batch=8, mirror=1.0)
    half = GroupDanceWindows(takes, dancers_per_batch=8, mirror=0.5)
    before = [take.x.clone() for take in takes]
    swapped = 0
    for step in range(8):
        (x, _, _), (y, _, S) = plain.batch(step), always.batch(step)
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
    x = GroupDanceWindows(takes).batch(3)[0][0]
    y = GroupDanceWindows(takes, shift=0.5).batch(3)[0][0]
    moved = y - x
    offset = moved[0, 0, 4:7]
    assert torch.allclose(moved[..., 4:7], offset.expand_as(moved[..., 4:7]), atol=1e-6)
    assert offset[1] == 0 and 0 < offset.abs().max() <= 0.5
    assert torch.equal(x[..., 7:], y[..., 7:]) and torch.equal(x[..., :4], y[..., :4])


@pytest.mark.parametrize(("name", "value"), [("mirror", 1.5), ("shift", -1.0)])
def test_wrong_augmentation_is_named(takes, name, value):
    with pytest.raises(ValueError, match=f"{name}={value}"):
        GroupDanceWindows(takes, **{name: value})


def many(songs=200, sizes=(1, 2)):
    x, M = torch.zeros(1, 1, 151), torch.zeros(1, 35)
    return [Take(f"{s}-{n}", x, M, f"song-{s}") for s in range(songs) for n in sizes]


def test_no_song_is_on_both_sides_of_a_split():
    takes = many()
    train, val = split_takes(takes, share=0.2)
    assert {t.name for t in train} | {t.name for t in val} == {t.name for t in takes}
    assert len(train) + len(val) == len(takes)
    assert not {t.song for t in train} & {t.song for t in val}
    assert 20 <= len({t.song for t in val}) <= 60  # 40 expected, 3.5 standard deviations


def test_a_song_keeps_its_side_when_others_join():
    few = {t.name for t in split_takes(many(50), share=0.2)[1]}
    more = {t.name for t in split_takes(many(200), share=0.2)[1]}
    assert few == more & {t.name for t in many(50)} and few < more
    assert few != {t.name for t in split_takes(many(50), share=0.2, seed=1)[1]}
    assert split_takes(many(3), share=0.0)[1] == []
    with pytest.raises(ValueError, match="share=1"):
        split_takes(many(3), share=1)


def test_windows_of_the_two_sides_share_no_frame():
    """What leakage would look like: a validation window that training has seen."""
    takes = [t for s in range(6) for t in choreographed_takes(s, seconds=6.0, sizes=(1,))]
    train, val = split_takes(takes, share=0.4)
    assert train and val
    seen = torch.cat([t.x[0, :, 7:] for t in train])
    for take in val:
        assert torch.cdist(take.x[0, :, 7:], seen).min() > 0.01


def same(a, b):
    return all(
        (p.name, p.song) == (q.name, q.song) and torch.equal(p.x, q.x) and torch.equal(p.M, q.M)
        for p, q in zip(a, b, strict=True)
    )


def test_cache_gives_the_same_takes_and_makes_only_what_is_missing(tmp_path, monkeypatch):
    plain = choreographed_corpus([4, 2], seconds=6.0, workers=1)
    assert [t.num_dancers for t in plain] == 2 * [1, 2, 3, 4, 5]
    assert same(plain[:5], choreographed_takes(4, seconds=6.0))
    assert same(plain, choreographed_corpus([4, 2], seconds=6.0, workers=1, cache=tmp_path))

    made, make = [], choreographed_takes

    def counted(seed, **options):
        made.append(seed)
        return make(seed, **options)

    monkeypatch.setattr(module, "choreographed_takes", counted)
    again = choreographed_corpus([4, 2, 7], seconds=6.0, workers=1, cache=tmp_path)
    assert same(plain, again[:10])
    assert made == [4, 7]  # one is made again to see that the cache is of this choreographer


def test_cache_survives_a_kill_between_two_files(tmp_path):
    whole = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    expected = [t.M.clone() for t in whole]
    (tmp_path / "synth-1.M.npy").unlink()
    (tmp_path / ".synth-1.M.npy.99.part").write_bytes(b"half a file")
    again = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    assert all(torch.equal(t.M, M) for t, M in zip(again, expected, strict=True))


def test_cache_of_another_choreographer_is_refused(tmp_path, monkeypatch):
    choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    with pytest.raises(ValueError, match="other seconds than 7"):
        choreographed_corpus([1], seconds=7.0, workers=1, cache=tmp_path)
    make = choreographed_takes

    def changed(seed, **options):
        return [Take(t.name, t.x + 0.01, t.M, t.song) for t in make(seed, **options)]

    monkeypatch.setattr(module, "choreographed_takes", changed)
    with pytest.raises(ValueError, match="another version of the choreographer"):
        choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)


def test_damaged_cache_file_is_named(tmp_path):
    choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)
    path = tmp_path / "synth-1.x.npy"
    for data in (path.read_bytes()[:-100], b"nonsense", b""):
        path.unlink()
        path.write_bytes(data)
        with pytest.raises(ValueError, match=r"synth-1\.x\.npy.*is damaged"):
            choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)


def test_changing_a_mapped_take_does_not_change_the_file(tmp_path):
    take = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)[0]
    take.x.add_(1.0)
    again = choreographed_corpus([1], seconds=6.0, workers=1, cache=tmp_path)[0]
    assert torch.allclose(again.x, take.x - 1.0, atol=1e-5)


@pytest.mark.slow
def test_several_processes_make_the_same_corpus(tmp_path):
    one = choreographed_corpus([0, 1], seconds=6.0, workers=1)
    two = choreographed_corpus([0, 1], seconds=6.0, workers=2, cache=tmp_path)
    for a, b in zip(one, two, strict=True):
        assert a.name == b.name
        torch.testing.assert_close(a.x, b.x, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(a.M, b.M, rtol=1e-4, atol=1e-3)


def test_captured_takes_have_the_share_that_was_asked_for():
    takes = [
        Take(
            f"{kind}{k}",
            torch.full((2, 20, 151), float(kind == "real")),
            torch.zeros(20, 35),
            kind=kind,
        )
        for kind, count in (("real", 1), ("composed", 1), ("synthetic", 18))
        for k in range(count)
    ]
    for share, expected in ((0.0, 0.0), (0.5, 0.25), (None, 0.05), (1.0, 0.5)):
        windows = GroupDanceWindows(takes, num_frames=10, dancers_per_batch=40, captured=share)
        real = torch.cat([windows.batch(step)[0] for step in range(40)]).mean()
        assert float(real) == pytest.approx(expected, abs=0.06)
    with pytest.raises(ValueError, match=r"captured=1\.5"):
        GroupDanceWindows(takes, num_frames=10, captured=1.5)


def test_a_group_size_without_captured_takes_uses_what_there_is():
    takes = [Take("made", torch.ones(1, 20, 151), torch.zeros(20, 35))]
    x, _, _ = GroupDanceWindows(takes, num_frames=10, captured=1.0).batch(0)
    assert torch.equal(x, torch.ones_like(x))
