import pytest
import torch

from dancediff.autoregression.network import moved_to_origin
from dancediff.autoregression.roll_out import forced_guesses, music_window, roll_out
from dancediff.motion.representation import TCDIFFPP

SONG = torch.arange(50.0)[:, None]


def watched(seen: list, targets: int = 4):
    """A step that notes what it is given and guesses the numbers that come next."""

    def step(history, music):
        seen.append((history[0, :, 0].tolist(), music[0, :, 0].tolist()))
        return history[:, -1:] + torch.arange(1.0, 1 + targets)[:, None]

    return step


@pytest.mark.parametrize("keep", [1, 3])
def test_a_step_keeps_so_many_frames_and_moves_the_music_by_as_many(keep):
    seen, start = [], torch.tensor([-2.0, -1.0, 0.0])[None, :, None]
    made = torch.cat(list(roll_out(watched(seen), start, SONG, frames=7, keep=keep, window=5)), 1)
    assert made[0, :7, 0].tolist() == [1, 2, 3, 4, 5, 6, 7]
    assert len(seen) == -(-7 // keep)
    for k, (history, music) in enumerate(seen):
        first = k * keep
        assert history == [first - 2, first - 1, first]
        assert music == [(first - 3 + i) % 50 for i in range(5)]  # from the history's first frame


def test_a_dance_may_be_longer_than_its_song():
    assert music_window(SONG, 48, 4).flatten().tolist() == [48, 49, 0, 1]


def test_keeping_more_than_is_guessed_is_refused():
    with pytest.raises(ValueError, match="keep=5 is more than the 4 frames"):
        next(roll_out(watched([]), torch.zeros(1, 3, 1), SONG, frames=9, keep=5, window=5))


def test_true_histories_show_the_error_of_one_guess():
    x = SONG[None, :20] * 2  # twice as fast as the step thinks
    guesses = forced_guesses(watched([]), x, SONG, history=3, keep=2, window=5)
    assert guesses.shape == (1, 17, 1)
    error = (x[:, 3:] - guesses)[0, :, 0]
    assert error.tolist() == [1.0 + k % 2 for k in range(17)]  # it begins anew each time
    free = roll_out(watched([]), x[:, :3], SONG, frames=17, keep=2, window=5)
    drift = (x[:, 3:] - torch.cat(list(free), 1)[:, :17])[0, :, 0]
    assert drift.tolist() == [1.0 + k for k in range(17)]


def test_only_places_on_the_floor_are_moved():
    x = torch.randn(2, 5, 151)
    y = moved_to_origin(x, at=-1)
    assert (y[:, -1, TCDIFFPP.floor] == 0).all()
    x[..., TCDIFFPP.floor] += 3
    assert torch.allclose(moved_to_origin(x, at=-1), y, atol=1e-6)
    rest = [k for k in range(151) if k not in (4, 6)]
    assert torch.equal(x[..., rest], y[..., rest])


def test_forced_guesses_hear_the_music_of_their_own_history():
    seen, x = [], torch.arange(9.0)[None, :, None]
    forced_guesses(watched(seen), x, SONG, history=3, keep=2, window=5)
    assert [music[0] for _, music in seen] == [0, 2, 4]
    assert [history[0] for history, _ in seen] == [0, 2, 4]
