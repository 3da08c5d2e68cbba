"""Sliders around a panel: drawn again, reset, pinned; slow ones run, report and stop."""

import threading

import numpy as np
import pytest
from matplotlib.figure import Figure

from dancediff.data.choreographer import choreograph
from dancediff.music.song import Music
from dancediff.viz import panels

widgets = pytest.importorskip("ipywidgets")


@pytest.fixture(scope="module")
def dance():
    return choreograph(np.arange(0.2, 2, 0.5), dancers=2, seed=1, seconds=1.0)[0]


def test_explore_redraws_and_resets():
    box = panels.explore(panels.pose_panel, z=panels.slider(-90, 90, 0, "degrees"))
    slider, first = box.controls["z"], bytes(box.picture.value)
    assert first.startswith(b"\x89PNG")
    assert box.run.layout.display == "none" and box.cancel.layout.display == "none"
    slider.value = 60
    assert box.picture.value != first
    box.reset.click()
    assert slider.value == 0
    assert box.picture.value == first


def test_no_broken_picture_before_the_first():
    def panel(n, report):
        return Figure()

    box = panels.explore(panel, n=panels.slider(0, 9, 1, "n"))
    assert box.picture.layout.display == "none"
    box.run.click()
    box.wait()
    assert box.picture.layout.display == ""


def test_sliders_begin_below_each_other():
    names = {"a": "n", "b": "a far longer label"}
    controls = {key: panels.slider(0, 9, 1, name) for key, name in names.items()}
    panels.explore(lambda a, b: Figure(), **controls)
    assert len({control.style.description_width for control in controls.values()}) == 1


def test_reset_of_many_sliders_draws_once():
    drawn = []

    def panel(a, b):
        drawn.append((a, b))
        return Figure()

    box = panels.explore(panel, a=panels.slider(0, 9, 1, "a"), b=panels.slider(0, 9, 2, "b"))
    box.controls["a"].value, box.controls["b"].value = 5, 6
    box.reset.click()
    assert drawn == [(1, 2), (5, 2), (5, 6), (1, 2)]


def test_explore_shows_an_error_in_words():
    box = panels.explore(panels.pose_panel, joint=panels.choice(["lhip", "tail"], "lhip", "joint"))
    before = box.picture.value
    box.controls["joint"].value = "tail"
    assert "ValueError" in box.message.value and "tail" in box.message.value
    assert box.picture.value == before
    box.controls["joint"].value = "lhip"
    assert box.message.value == ""


def test_a_pinned_picture_stays_below():
    box = panels.explore(panels.pose_panel, z=panels.slider(-90, 90, 0, "degrees"))
    first = box.picture.value
    box.pin.click()
    box.controls["z"].value = 60
    assert box.pinned.value == first != box.picture.value
    assert box.pinned.layout.display == ""
    box.pin.click()
    assert box.pinned.value == b"" and box.pinned.layout.display == "none"


class Slow:
    """A panel that takes a step whenever it is let to."""

    def __init__(self, dance=None):
        self.dance, self.go, self.begun = dance, threading.Semaphore(0), threading.Event()
        self.finished = []

    def __call__(self, seed, report):
        for step in range(4):
            report(step, 4)
            self.begun.set()
            assert self.go.acquire(timeout=20)
        report(4, 4)
        self.finished.append(seed)
        figure = Figure()
        figure.suptitle(f"seed {seed}")
        return figure if self.dance is None else (figure, self.dance)


def slow_box(dance=None):
    panel = Slow(dance)

    def slow(seed, report):
        return panel(seed, report)

    return panel, panels.explore(slow, seed=panels.slider(0, 9, 0, "seed"))


def test_a_slow_panel_waits_for_its_button_and_shows_progress():
    panel, box = slow_box()
    box.controls["seed"].value = 1
    assert box.picture.value == b"" and not panel.begun.is_set()
    assert box.run.layout.display == ""
    box.run.click()
    assert panel.begun.wait(20)
    assert box.cancel.layout.display == "" and box.bar.max == 4
    panel.go.release(4)
    box.wait()
    assert box.bar.value == 4 and bytes(box.picture.value).startswith(b"\x89PNG")
    assert box.cancel.layout.display == "none" and panel.finished == [1]


def test_cancel_stops_it():
    panel, box = slow_box()
    box.run.click()
    assert panel.begun.wait(20)
    box.cancel.click()
    panel.go.release(4)
    box.wait()
    assert panel.finished == [] and box.picture.value == b""
    assert box.message.value == "cancelled"
    box.run.click()
    panel.go.release(4)
    box.wait()
    assert panel.finished == [0]


def test_the_newest_request_wins():
    """Whoever moves a slider while it dances gets the dance of the slider's last place only."""
    panel, box = slow_box()
    panel.go.release(4)
    box.run.click()
    box.wait()
    panel.begun.clear()
    box.controls["seed"].value = 3
    assert panel.begun.wait(20)
    box.controls["seed"].value = 4
    box.controls["seed"].value = 5
    panel.go.release(20)
    box.wait()
    assert panel.finished == [0, 5]


def test_an_error_of_a_slow_panel_is_said():
    def fails(report):
        raise RuntimeError("the song is <silent>")

    box = panels.explore(fails)
    box.run.click()
    box.wait()
    assert "the song is &lt;silent&gt;" in box.message.value
    assert box.cancel.layout.display == "none"


def test_a_control_s_error_is_said():
    """Of a place beside the floor, say."""

    class Broken(widgets.IntSlider):
        broken = False

        def __getattribute__(self, name):
            if name == "value" and object.__getattribute__(self, "broken"):
                raise ValueError("beside the floor")
            return super().__getattribute__(name)

    control = Broken()
    box = panels.explore(lambda at, report: Figure(), at=control)
    control.broken = True
    box.run.click()
    box.wait()
    assert "beside the floor" in box.message.value
    assert box.cancel.layout.display == "none"
    control.broken = False
    box.run.click()
    box.wait()
    assert box.message.value == "" and box.picture.value


def test_a_dance_can_be_watched_beside_the_pinned_one(dance):
    pytest.importorskip("pythreejs")
    panel, box = slow_box(dance)
    assert box.watch.layout.display == "none"
    panel.go.release(100)
    box.run.click()
    box.wait()
    assert box.dance is dance and box.watch.layout.display == ""
    box.watch.click()
    alone = box.stage.children[0]
    box.pin.click()
    panel.dance = dance.frames(0, 20)
    box.controls["seed"].value = 2
    box.wait()
    box.watch.click()
    assert box.dance_a is dance and box.stage.children[0] is not alone


def test_a_dance_that_comes_with_its_song_is_heard(dance):
    pytest.importorskip("pythreejs")
    song = Music(np.zeros((16000, 1), np.float32), 16000, name="rests")
    box = panels.explore(lambda size: (Figure(), dance, song), size=panels.slider(1, 9, 1, "size"))
    box.watch.click()
    _, _, _, buttons, _ = box.stage.children[0].children
    assert "sound" in [control.description for control in buttons.children]
