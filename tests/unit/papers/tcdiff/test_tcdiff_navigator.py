"""TCDiff's first stage: who depends on what, roll-out, smoothing, losses, starts."""

import pytest
import torch

from dancediff.papers.tcdiff.losses import path_losses
from dancediff.papers.tcdiff.navigator import Navigator, roll_out
from dancediff.papers.tcdiff.path_smoothing import smoothed
from dancediff.papers.tcdiff.start_formations import StartFormations


@pytest.fixture
def navigator():
    return Navigator(35, width=8, music_hidden=16, num_layers=2, num_heads=2).eval()


def inputs(b=2, n=3, h=20):
    return torch.randn(b, n, h, 2), torch.randn(b, h, 35), torch.randn(b, h, 35)


def changed_frames(first, second):
    return (first != second).flatten(3).any(3).any(0).any(0).nonzero().flatten().tolist()


def test_a_guess_follows_from_the_past_alone(navigator):
    path, music, later = inputs()
    plain = navigator(path, music, later)
    for k in range(3):
        given = [path.clone(), music.clone(), later.clone()]
        given[k][..., 12, :] += 1
        found = changed_frames(navigator(*given), plain)
        assert found == ([12] if k == 2 else list(range(12, 20)))


def test_a_clip_depends_on_no_other_and_dancers_on_each_other(navigator):
    path, music, later = inputs()
    plain = navigator(path, music, later)
    alone = navigator(path[1:], music[1:], later[1:])
    assert torch.allclose(plain[1:], alone, atol=1e-6)
    other = path.clone()
    other[:, 2, 3] += 1
    moved = (navigator(other, music, later) - plain)[:, 0].abs().amax((0, 2))
    assert not moved[:3].any() and moved[3:].any()
    order = torch.tensor([2, 0, 1])
    assert torch.allclose(navigator(path[:, order], music, later), plain[:, order], atol=1e-5)


def test_roll_out_appends_the_last_guesses_and_hears_the_right_music():
    """A "navigator" whose guess is the last known place plus the music of the guessed frame."""

    def follow(path, music, later):
        seen.append((music[0, :, 0].clone(), later[0, :, 0].clone()))
        return path[:, :, -1:] + later[:, None, :, :1]

    seen: list = []
    music = torch.arange(1.0, 11.0)[None, :, None]
    start = torch.tensor([[[0.0, 0.0], [5.0, 5.0]]])
    path = roll_out(follow, start, music, history=6, stride=4)
    assert path.shape == (1, 2, 10, 2)
    assert path[0, :, :, 0].tolist() == [
        [1, 2, 3, 4, 9, 10, 11, 12, 21, 22],
        [6, 7, 8, 9, 14, 15, 16, 17, 26, 27],
    ]
    assert [one.tolist() for one in seen[0]] == [[0] * 6, [0, 0, 1, 2, 3, 4]]
    assert [one.tolist() for one in seen[1]] == [[0, 0, 1, 2, 3, 4], [3, 4, 5, 6, 7, 8]]


def test_smoothing_leaves_lines_and_calms_noise():
    line = torch.stack([torch.linspace(-1, 2, 60), torch.zeros(60)])
    assert torch.allclose(smoothed(line), line, atol=1e-4)
    noise = torch.randn(20, 60, generator=torch.Generator().manual_seed(0))
    assert smoothed(noise).var() < 0.7 * noise.var()
    assert smoothed(noise).diff(dim=-1).var() < 0.1 * noise.diff(dim=-1).var()
    assert torch.equal(smoothed(noise[:, :1]), noise[:, :1])


def test_smoothing_does_not_lag_behind():
    wave = torch.sin(torch.arange(90) / 8)
    noisy = wave + 0.1 * torch.randn(90, generator=torch.Generator().manual_seed(1))
    errors = [(smoothed(noisy)[10:80] - wave.roll(k)[10:80]).square().mean() for k in range(4)]
    assert errors == sorted(errors)


def test_path_losses_count_all_pairs_but_not_the_place_of_the_group():
    truth = torch.randn(2, 3, 9, 2)
    assert all(value == 0 for value in path_losses(truth, truth).values())
    shifted = path_losses(truth + 0.5, truth)
    assert shifted["path"].item() == pytest.approx(0.25)
    assert shifted["path_distance"] < 1e-10 and shifted["path_velocity"] < 1e-10
    outer = truth.clone()
    outer[:, 0] += 1  # two of three pairs are wrong by 1
    assert path_losses(outer, truth)["path_distance"].item() == pytest.approx(2 / 3)
    jump = truth.clone()
    jump[:, :, 5:] += 1  # one of eight changes from frame to frame is wrong by 1
    assert path_losses(jump, truth)["path_velocity"].item() == pytest.approx(1 / 8)
    assert path_losses(truth[:, :1], truth[:, :1] + 1)["path_distance"] == 0


def test_starts_have_the_mean_and_the_spread_of_the_groups():
    start = StartFormations(max_dancers=3)
    groups = torch.randn(500, 2, 2) * 0.3 + torch.tensor([[-1.0, 0.0], [1.0, 0.0]])
    start.fit([groups[:200], groups[200:]])
    drawn = start(2, 4000, torch.Generator().manual_seed(0))
    assert torch.allclose(drawn.mean(0), groups.mean(0), atol=0.03)
    assert torch.allclose(drawn.std(0), groups.std(0), atol=0.03)
    with pytest.raises(ValueError, match=r"dancers=3: no such group.*ask for \[2\]"):
        start(3, 1)
    assert not start(1, 1).any() and not StartFormations(3)(3, 1).any()  # nothing is learned yet
