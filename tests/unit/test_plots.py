import sys

import matplotlib
import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from dancediff.motion.motion import Motion
from dancediff.music.features import BEATS, NUM_FEATURES
from dancediff.viz import plots


def line_up(n=3, f=30, contact=None):
    """Dancers a metre apart, dancer 1 farthest right, each walking half a metre to the front."""
    root = torch.zeros(n, f, 3)
    root[..., 0] = 1.0 - torch.arange(n, dtype=torch.float32)[:, None]
    root[..., 1] = 0.95
    root[..., 2] = torch.linspace(0, 0.5, f)
    return Motion(torch.eye(3).expand(n, f, 24, 3, 3), root, contact=contact)


@pytest.fixture
def ax():
    return Figure().subplots()


def test_filmstrip_leaves_no_window_and_no_setting_behind():
    import matplotlib.pyplot as plt

    before, windows = dict(matplotlib.rcParams), plt.get_fignums()
    figure = plots.plot_filmstrip(line_up(), count=4)
    assert len(figure.axes) == 4 + 2  # moments, floor paths, contacts
    assert plt.get_fignums() == windows
    assert dict(matplotlib.rcParams) == before


@pytest.mark.parametrize("n", [1, 2, 5])
def test_filmstrip_of_any_group(n):
    figure = plots.plot_filmstrip(line_up(n, f=5), count=2, title="A title")
    assert figure.get_suptitle() == "A title"


def test_filmstrip_captions_are_the_times():
    figure = plots.plot_filmstrip(line_up(1, f=60), count=2)
    assert [a.get_title(loc="left") for a in figure.axes[:2]] == ["0.5 s", "1.5 s"]


@pytest.mark.parametrize("count", [0, 25])
def test_filmstrip_names_a_bad_count(count):
    with pytest.raises(ValueError, match=f"count={count}"):
        plots.plot_filmstrip(line_up(), count=count)


def test_moments_move_to_beats_only_where_they_stay_apart():
    assert plots.moments(90, 3, [44]) == [15, 44, 75]
    assert plots.moments(90, 3, [500]) == [15, 45, 75]  # beats after the end do not count


def test_save_filmstrip(tmp_path):
    line_up(f=4).save(tmp_path / "dance.png")
    assert (tmp_path / "dance.png").read_bytes()[:4] == b"\x89PNG"
    assert [p.name for p in tmp_path.iterdir()] == ["dance.png"]


def test_a_failed_save_keeps_the_old_file_and_leaves_nothing(tmp_path, monkeypatch):
    def break_off(self, file, **_):
        file.write_bytes(b"half a picture")
        raise OSError("disk full")

    old = tmp_path / "dance.png"
    old.write_bytes(b"old")
    monkeypatch.setattr(Figure, "savefig", break_off)
    with pytest.raises(OSError, match="disk full"):
        plots.save_filmstrip(line_up(f=4), old)
    assert old.read_bytes() == b"old"
    assert [p.name for p in tmp_path.iterdir()] == ["dance.png"]


def test_floor_paths_left_is_left_and_the_audience_is_below(ax):
    motion = line_up()
    assert plots.plot_floor_paths(motion, ax=ax) is ax
    ends = motion.root[:, -1][:, [0, 2]].numpy()
    ends_seen = {text.get_text(): text.xy for text in ax.texts}
    assert sorted(ends_seen) == ["1", "2", "3"]
    assert all(np.allclose(ends_seen[str(k + 1)], ends[k]) for k in range(3))
    x = ax.transData.transform(ends)[:, 0]
    assert x[2] < x[1] < x[0]
    back, front = ax.transData.transform([(0, 0), (0, 0.5)])[:, 1]
    assert front < back


def test_contact_strip_colours_what_stands(ax):
    contact = torch.zeros(1, 30, 4)
    contact[0, :10, 0] = 1  # left ankle
    contact[0, 10:15, 2] = 1  # left toe: the same foot stands on
    contact[0, 20:, 1] = 1  # right ankle
    assert plots.plot_contact_strip(line_up(1, contact=contact), ax=ax) is ax
    left, right = (np.asarray(image.get_array())[0].min(-1) < 0.99 for image in ax.images)
    assert left.nonzero()[0].tolist() == list(range(15))
    assert right.nonzero()[0].tolist() == list(range(20, 30))
    upper, lower = (image.get_extent()[2] for image in ax.images)
    assert upper > lower  # the left foot lies above the right one


def test_features_mark_the_beats():
    M = np.zeros((90, NUM_FEATURES), dtype=np.float32)
    M[[15, 60], BEATS] = 1
    import matplotlib.pyplot as plt

    top = plots.plot_features(M)
    beats = sorted(line.get_xdata()[0] for line in top.lines if len(line.get_xdata()) == 2)
    plt.close(top.figure)
    assert beats == pytest.approx([0.5, 2.0])


def test_skeleton_numbers_every_joint(ax):
    joints = line_up(1, f=1).joints()[0, 0]
    assert plots.plot_skeleton(joints, ax=ax) is ax
    assert [text.get_text() for text in ax.texts] == [str(j) for j in range(24)]
    assert np.allclose([text.xy for text in ax.texts], joints[:, :2])


def test_noise_filmstrip_wants_a_label_for_each():
    dances = [line_up(f=2)] * 3
    figure = plots.plot_noise_filmstrip(dances, ["a", "b", "c"])
    assert [a.get_title(loc="left") for a in figure.axes] == ["a", "b", "c"]
    with pytest.raises(ValueError, match="3 dances"):
        plots.plot_noise_filmstrip(dances, ["a"])


def test_importing_plots_does_not_import_matplotlib():
    import subprocess

    code = "import sys, dancediff.viz.plots, dancediff.viz.video; print(sorted(sys.modules))"
    names = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "'dancediff.viz.plots'" in names.stdout
    assert not any(f"'{name}'" in names.stdout for name in ("matplotlib", "av", "librosa"))
