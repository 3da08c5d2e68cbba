from functools import partial

import numpy as np
import pytest
import torch
from matplotlib.figure import Figure

from dancediff.data.choreographer import choreograph
from dancediff.diffusion.schedule import cosine_abar
from dancediff.motion.representation import Normalizer
from dancediff.music.song import Music
from dancediff.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.viz import panels

widgets = pytest.importorskip("ipywidgets")


@pytest.fixture(scope="module")
def noisy():
    x = choreograph(np.arange(0.2, 4, 0.5), dancers=2, seed=1, seconds=2.0)[0].features()
    norm = Normalizer.fit(x)
    return partial(panels.noise_panel, norm.normalize(x), norm, cosine_abar(1000), frame=20)


@pytest.fixture(scope="module")
def song():
    rng = np.random.default_rng(0)
    audio = np.zeros(15360 * 6, dtype=np.float32)
    for start in range(2000, len(audio) - 800, 7680):
        audio[start : start + 600] = rng.normal(0, 0.3, 600) * np.hanning(600)
    return Music(audio, 15360, "clicks")


def png_of(box):
    return bytes(next(c.value for c in box.children if isinstance(c, widgets.Image)))


def test_pose_panel_shows_the_six_numbers():
    figure = panels.pose_panel("lknee", x=90)
    widths = [bar.get_width() for bar in figure.axes[1].patches]
    np.testing.assert_allclose(widths, [1, 0, 0, 0, 0, -1], atol=1e-6)
    assert panels.as_png(figure) != panels.as_png(panels.pose_panel("lknee", x=0))


def test_pose_panel_refuses_an_unknown_joint():
    with pytest.raises(ValueError, match="'tail'"):
        panels.pose_panel("tail")


def test_peaks_panel_counts_fewer_peaks_above_a_higher_threshold(song):
    counts = []
    for threshold in (0.0, 2.0, 1000.0):
        figure = panels.peaks_panel(song, threshold, seconds=5)
        counts.append(int(figure.axes[0].get_title("left").split()[0]))
    assert counts[0] >= counts[1] > counts[2] == 0


def test_peaks_panel_near_the_end_of_the_song(song):
    assert isinstance(panels.peaks_panel(song, start=5.0), Figure)


def test_noise_panel_starts_clean_and_is_seeded(noisy):
    assert panels.as_png(noisy(t=300)) == panels.as_png(noisy(t=300))
    assert panels.as_png(noisy(t=300)) != panels.as_png(noisy(t=300, seed=1))
    assert "100.0%" in noisy(t=0).axes[1].get_title("left")
    assert "0.0%" in noisy(t=999).axes[1].get_title("left")


def test_dance_panel_asks_the_model(song):
    torch.manual_seed(0)
    small = TCDiffPPConfig(d_model=32, num_layers=1, num_heads=2, ff_dim=32, max_dancers=2)
    figure = panels.dance_panel(
        TCDiffPP(small).eval(), song, dancers=2, seconds=1.0, steps=2, seed=7
    )
    assert figure.get_suptitle().startswith("seed 7: 2 dancers")


def test_explore_redraws_and_resets():
    box = panels.explore(panels.pose_panel, z=panels.slider(-90, 90, 0, "degrees"))
    slider, first = box.children[0], png_of(box)
    assert first.startswith(b"\x89PNG")
    slider.value = 60
    assert png_of(box) != first
    box.children[1].click()
    assert slider.value == 0
    assert png_of(box) == first


def test_explore_shows_an_error_in_words():
    box = panels.explore(panels.pose_panel, joint=panels.choice(["lhip", "tail"], "lhip", "joint"))
    before = png_of(box)
    box.children[0].value = "tail"
    messages = [child.value for child in box.children if isinstance(child, widgets.HTML)]
    assert "ValueError" in messages[0] and "tail" in messages[0]
    assert png_of(box) == before
    box.children[0].value = "lhip"
    assert [c.value for c in box.children if isinstance(c, widgets.HTML)] == [""]


def test_sliders_wait_until_they_are_let_go():
    whole, part = panels.slider(0, 5, 1, "a"), panels.slider(0.0, 1.0, 0.5, "b")
    assert isinstance(whole, widgets.IntSlider) and isinstance(part, widgets.FloatSlider)
    assert not whole.continuous_update and not part.continuous_update
