"""Charts draw what they say: the numbers in them are those of the dance."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.motion.beats import mean_speed
from dancediff.motion.motion import Motion
from dancediff.papers.lodge.primitives import primitives_of
from dancediff.viz import charts

BEATS = np.arange(0.2, 36, 0.5)


@pytest.fixture(autouse=True)
def _close():
    yield
    plt.close("all")


@pytest.fixture(scope="module")
def group():
    return choreograph(BEATS, dancers=3, seed=1, seconds=10)[0]


def still(*places):
    root = torch.tensor(places).float()[:, None].repeat(1, 30, 1)
    return Motion(torch.eye(3).expand(len(places), 30, 24, 3, 3), root)


def test_energy_is_the_mean_joint_speed_with_its_primitives():
    dance = choreograph(BEATS, dancers=1, seed=5, seconds=1024 / 30)[0]
    _, frames = primitives_of(dance.features("lodge")[0])
    soft = [row for k, row in enumerate(frames) if k % 3]
    ax = charts.plot_energy(dance, hard=frames[::3], soft=soft, beats=BEATS, seams=[256])
    drawn = ax.lines[0].get_ydata()
    np.testing.assert_allclose(drawn, 30 * mean_speed(dance.joints()[0]))
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["hard", "soft"]
    assert len(ax.patches) == 13
    assert ax.patches[1].get_x() == pytest.approx(int(frames[3, 0]) / 30)


def test_rests_on_beats_are_filled(group):
    ax = charts.plot_beat_alignment(group, BEATS)
    share = int(ax.get_title(loc="left").split("%")[0])
    assert share > 80  # the choreographer rests on beats
    late = charts.plot_beat_alignment(group, BEATS + 0.25)
    assert int(late.get_title(loc="left").split("%")[0]) < share - 40


def test_distances_name_the_nearest_pair():
    ax = charts.plot_distances(still((0, 0, 0), (0.2, 0, 0), (0, 0, 2.0)))
    assert ax.get_title(loc="left") == "Nearest: 0.20 m"
    rows = ax.images[0].get_array()
    np.testing.assert_allclose(rows[:, 0], [0.2, 2.0, np.hypot(0.2, 2.0)], rtol=1e-5)
    assert [len(line.get_xdata()) for line in ax.lines] == [30, 0, 0]  # only 1 and 2 touch
    with pytest.raises(ValueError, match="at least 2 dancers"):
        charts.plot_distances(still((0, 0, 0)))


def test_losses_are_means_of_their_first(tmp_path):
    path = tmp_path / "losses.csv"
    path.write_text(
        "step,seconds,simple,fk\n" + "".join(f"{k},0,{8 - k % 4},{k + 1}\n" for k in range(8))
    )
    ax = charts.plot_losses(path, smooth=4)
    assert [t.get_text() for t in ax.get_legend().get_texts()] == ["simple", "fk"]
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [1, 1])
    np.testing.assert_allclose(ax.lines[1].get_ydata(), [1, 6.5 / 2.5])
    with pytest.raises(ValueError, match="'nope' is not one of simple, fk"):
        charts.plot_losses(path, names=["nope"])
    path.write_text("hello\nworld\n")
    with pytest.raises(ValueError, match=r"no losses\.csv"):
        charts.plot_losses(path)


def test_radar_shows_ratios():
    reference = {"FSR": 0.1, "PFC": 1.0, "GMC": 60.0}
    ax = charts.plot_radar({"ours": {"FSR": 0.2, "PFC": 0.5, "GMC": 60.0}}, reference)
    np.testing.assert_allclose(ax.lines[0].get_ydata(), [3, 1, 2, 3])
    with pytest.raises(ValueError, match="'ours' lacks GMC"):
        charts.plot_radar({"ours": {"FSR": 0.2, "PFC": 0.5}}, reference)
    with pytest.raises(ValueError, match="needs 3"):
        charts.plot_radar({}, {"FSR": 1.0})
    with pytest.raises(ValueError, match="ax is rectilinear"):
        charts.plot_radar({}, reference, ax=plt.subplots()[1])
