from functools import partial

import numpy as np
import pytest
from matplotlib.figure import Figure

from dancediff.data.choreographer import choreograph
from dancediff.diffusion.schedule import cosine_abar
from dancediff.motion.representation import Normalizer
from dancediff.music.song import Music
from dancediff.viz import panels
from dancediff.viz.style import as_png

widgets = pytest.importorskip("ipywidgets")


@pytest.fixture(scope="module")
def noisy():
    x = choreograph(np.arange(0.2, 4, 0.5), dancers=2, seed=1, seconds=2.0)[0].features()
    norm = Normalizer.fit(x)
    return partial(panels.noise_panel, norm.normalize(x), norm, cosine_abar(1000), frame=20)


@pytest.fixture(scope="module")
def group():
    """Two dancers, four seconds."""
    return choreograph(np.arange(0.2, 4, 0.5), dancers=2, seed=1, seconds=4.0)[0]


@pytest.fixture(scope="module")
def song():
    rng = np.random.default_rng(0)
    audio = np.zeros(15360 * 6, dtype=np.float32)
    for start in range(2000, len(audio) - 800, 7680):
        audio[start : start + 600] = rng.normal(0, 0.3, 600) * np.hanning(600)
    return Music(audio, 15360, "clicks")


def test_pose_panel_shows_the_six_numbers():
    figure = panels.pose_panel("lknee", x=90)
    widths = [bar.get_width() for bar in figure.axes[1].patches]
    np.testing.assert_allclose(widths, [1, 0, 0, 0, 0, -1], atol=1e-6)
    assert as_png(figure) != as_png(panels.pose_panel("lknee", x=0))


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
    assert as_png(noisy(t=300)) == as_png(noisy(t=300))
    assert as_png(noisy(t=300)) != as_png(noisy(t=300, seed=1))
    assert noisy(t=0).axes[1].get_title("left").endswith("power 100.0%")
    assert noisy(t=999).axes[1].get_title("left").endswith("power 0.0%")


def test_loss_panel_tells_damages_apart(group):
    """No damage costs nothing; each damage is noticed by the loss that was made for it."""
    x, norm = group.features(), Normalizer.fit(group.features())

    def costs(**damage):
        ax = panels.loss_panel(x, norm, **damage).axes[0]
        return dict(zip(("simple", "vel", "fk", "contact", "dist"), ax.patches, strict=True)), ax

    fine, ax = costs()
    assert ax.get_title("left").startswith("Nobody") and fine["fk"].get_width() < 1e-6
    slides, _ = costs(slide=3.0)
    assert slides["contact"].get_width() > 1e-3 and slides["dist"].get_width() < 1e-6
    meet, _ = costs(closer=1.0)
    assert meet["dist"].get_width() > 0.1
    trembles, ax = costs(shake=20.0)
    assert trembles["vel"].get_width() > 1e-3
    worst = max(trembles, key=lambda name: trembles[name].get_width())
    assert worst in ax.get_title("left")


def test_metric_panel_shows_before_and_after(group):
    beats = np.arange(0.2, 4, 0.5)
    figure = panels.metric_panel(group, beats, "drag_feet", 1.0)
    before, after = (bar.get_height() for bar in figure.axes[0].patches)
    assert after > before + 0.3
    frozen = panels.metric_panel(group, beats, "freeze", 0.0)
    assert all(len({bar.get_height() for bar in ax.patches}) == 1 for ax in frozen.axes)


@pytest.mark.parametrize("damage", panels.DAMAGES)
def test_every_damage_can_be_chosen(group, damage):
    assert isinstance(panels.metric_panel(group, [0.5, 1.0], damage, 0.4), Figure)


def test_metric_panel_refuses_other_functions(group):
    with pytest.raises(ValueError, match="damage='collapse' is not one of drag_feet"):
        panels.metric_panel(group, [0.5], "collapse")


def test_sliders_wait_until_they_are_let_go():
    whole, part = panels.slider(0, 5, 1, "a"), panels.slider(0.0, 1.0, 0.5, "b")
    assert isinstance(whole, widgets.IntSlider) and isinstance(part, widgets.FloatSlider)
    assert not whole.continuous_update and not part.continuous_update
