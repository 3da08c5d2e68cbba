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


def test_speed_begins_at_0_also_of_a_statue_and_beside_a_faster_dance():
    pose, root = torch.eye(3).expand(1, 30, 24, 3, 3), torch.zeros(1, 30, 3)
    run = root + torch.arange(30.0)[:, None] * torch.tensor([0.1, 0, 0])
    _, axes = plt.subplots(1, 2, sharey=True)
    charts.plot_energy(Motion(pose, run), ax=axes[0])
    charts.plot_energy(Motion(pose, root), ax=axes[1], beats=[0.5])
    assert axes[0].get_ylim()[0] == 0 and axes[0].get_ylim()[1] > 3


def test_hard_and_soft_frames_differ_without_colour():
    dance = choreograph(BEATS, dancers=1, seed=5, seconds=4)[0]
    hard, soft = charts.plot_energy(dance, hard=[[0, 8]], soft=[[30, 38]]).patches
    assert hard.get_alpha() > 2 * soft.get_alpha()


@pytest.mark.parametrize(("axis", "channel"), [("x", 0), ("z", 2)])
def test_lanes_are_numbered_at_their_ends(axis, channel):
    dance = choreograph(BEATS, dancers=3, seed=5, seconds=4)[0]
    ax = charts.plot_lanes(dance, axis=axis)
    for k, (line, number) in enumerate(zip(ax.lines, ax.texts, strict=True)):
        np.testing.assert_array_equal(line.get_ydata(), dance.root[k, :, channel])
        assert number.get_text() == str(k) and number.get_color() == line.get_color()
        assert number.xy[0] == line.get_xdata()[-1]
    heights, ends = np.array([n.xy[1] for n in ax.texts]), dance.root[:, -1, channel].numpy()
    assert (heights.argsort() == ends.argsort()).all()
    points = ax.transData.transform(np.stack([0 * heights, heights], 1))[:, 1] * 72 / ax.figure.dpi
    assert np.diff(np.sort(points)).min() > 9  # none over another
    assert np.abs(heights - ends).max() < 0.3  # and none far from its line


def test_lanes_know_two_axes():
    dance = choreograph(BEATS, dancers=1, seed=5, seconds=1)[0]
    with pytest.raises(ValueError, match="axis='y' is not one of x, z"):
        charts.plot_lanes(dance, axis="y")
