import io
import json
import re

import numpy as np
import pytest
import soundfile

from dancediff.music.song import Music
from dancediff.viz import stage_timeline
from dancediff.viz.in_page import FOLDER
from dancediff.viz.style import mp3

p3 = pytest.importorskip("pythreejs")
widgets = pytest.importorskip("ipywidgets")


class Song:
    """Beats, and nothing else that the ruler asks for."""

    def beats(self):
        return np.array([0.0, 1.0, 2.0, 3.0])


def test_beats_are_where_the_slider_is_then():
    drawn = stage_timeline.ticks(412, 61, 30.0, Song())  # 400 pixels for two seconds
    strokes = [float(x) + 0.75 for x in re.findall(r'<rect x="([\d.]+)"', drawn)]
    np.testing.assert_allclose(strokes, [6, 206, 406], atol=0.06)  # no beat after the dance
    assert "3 beats" in drawn


def test_sound_is_as_long_as_the_dance():
    song = Music(np.zeros((44100 * 2, 2), dtype=np.float32), 44100)
    for seconds in (1.0, 3.0):
        audio, rate = soundfile.read(io.BytesIO(mp3(song, seconds)))
        assert abs(len(audio) / rate - seconds) < 0.1


def test_conductor_is_told_whom_it_moves():
    slider = widgets.IntSlider()
    surface = stage_timeline.conduct(p3, {"slider": slider}, 30, 30.0, [])
    facts = json.loads(re.search(r"this\.widget_manager, (\{.*\})\)", surface.func)[1])
    assert np.shape(facts.pop("rest")) == (24, 3)
    assert facts == {"models": {"slider": slider.model_id}, "frames": 30, "fps": 30.0, "views": []}


def test_conductor_sends_nothing_while_it_plays():
    """What is saved goes to the kernel: that may happen when a button is pressed, never before."""
    code = (FOLDER / "conductor.js").read_text(encoding="utf-8")
    tick = code[code.index("function tick()") : code.index('on(play, "change:value"')]
    show = code[code.index("function show(") : code.index("function start()")]
    assert "save_changes" not in tick + show and ".send(" not in code
