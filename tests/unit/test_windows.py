import numpy as np
import pytest
import torch

from dancediff.data.windows import GroupDanceWindows, Take, choreographed_takes, rank_left_to_right


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
