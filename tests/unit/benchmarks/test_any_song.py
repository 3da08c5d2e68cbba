"""What benchmarks/any_song.py measures, on dances whose truth is known, and its table."""

import json
import sys

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.motion.motion import Motion
from dancediff.music.song import Music
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import any_song as bench
import hard_songs as songs

BEATS = np.arange(0.5, 12, 0.5)


@pytest.fixture(scope="module")
def trio() -> Motion:
    return choreograph(BEATS, dancers=3, seed=1, seconds=12)[0]


def noise(seconds: float, level) -> Music:
    """White noise whose level over time is given."""
    rng = np.random.default_rng(0)
    y = rng.normal(size=round(seconds * songs.RATE)) * 0.1
    at = np.arange(len(y)) / songs.RATE
    return Music((y * level(at)).astype(np.float32), songs.RATE)


def test_a_choreographed_dance_meets_the_bars_of_movement(trio):
    found = bench.moves(trio, BEATS)
    assert found.in_range == 1
    assert found.feet_still > 0.9
    assert found.step < 0.12
    assert found.apart == 1
    assert found.beats_hit > 0.85


def test_a_statue_a_runner_and_a_heap_do_not(trio):
    still = Motion(trio.pose[:, :1].expand_as(trio.pose), trio.root[:, :1].expand_as(trio.root))
    assert bench.moves(still, BEATS).in_range == 0
    assert np.isnan(bench.moves(still, np.zeros(0)).beats_hit)
    running = trio.root + torch.arange(trio.num_frames)[None, :, None] * torch.tensor([0.2, 0, 0])
    found = bench.moves(Motion(trio.pose, running), BEATS)
    assert found.fastest > 5
    assert found.step > 0.15
    assert found.feet_still < 0.1
    heap = Motion(trio.pose, trio.root[:1].expand_as(trio.root))
    assert bench.moves(heap, BEATS).apart == 0


def test_loudness_is_a_weighted_and_followed():
    music = noise(12, lambda t: 0.1 + (t > 6))
    level = bench.loudness(music)
    assert level.shape == (6,)
    assert level[4] > 5 * level[1]
    t = np.arange(12 * songs.RATE) / songs.RATE
    low, middle = (
        Music(np.sin(2 * np.pi * hertz * t).astype(np.float32), songs.RATE) for hertz in (50, 1000)
    )
    gain = bench.loudness(low).mean() / bench.loudness(middle).mean()
    assert 20 * np.log10(gain) == pytest.approx(-30.2, abs=2)  # IEC 61672 at 50 Hz


def test_speed_that_follows_is_told_from_speed_that_does_not(trio):
    speed = bench.in_windows(bench.joint_speed(trio.joints()), bench.SHORT)
    beats = BEATS[BEATS < 11]
    follows = bench.listening(trio, beats, np.append(speed, 0))
    assert follows.follows == pytest.approx(1)
    assert bench.listening(trio, beats, 1 - speed).follows == pytest.approx(-1)
    assert follows.own > 1.6 * follows.shifted


def test_bars_hold_or_not_and_draw_whole_songs():
    halves = [[0.5, 0.7], [0.9, 1.1], [0.6, 0.8]]
    bar = bench.mean_bar("x", halves, np.mean, least=0.7)
    assert bar.value == pytest.approx(np.mean(halves))
    assert bar.holds is True
    assert bar.interval[0] < bar.value < bar.interval[1]
    assert bench.mean_bar("x", halves, np.mean, most=0.7).holds is False
    assert bench.mean_bar("x", halves, np.mean).holds is None


def test_a_column_goes_beside_those_of_other_models(tmp_path):
    for label, value in (("before", 1.0), ("after", 2.0), ("before", 3.0)):
        table = bench.AnySong("a model", label=label, results=tmp_path)
        table.write([bench.Bar("one", value, True), bench.Bar(label, value)])
    stored = json.loads((tmp_path / "any_song.json").read_text(encoding="utf-8"))
    assert stored["columns"] == ["bar", "before", "after"]
    assert stored["rows"][0] == ["one", "3.000, yes", "2.000, yes"]
    assert ["after", None, "2.000"] in stored["rows"]


def test_dances_are_named_apart_and_not_danced_again(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "SECONDS", 6.0)
    song = songs.HardSong("a, b", "", "synthetic", songs.waltz().music.slice(0, 6), BEATS)
    jobs = [bench.Job(song, n, seed, g) for n in (1, 2) for seed in (0, 1) for g in (None, "jazz")]
    assert len({job.name for job in jobs}) == len(jobs)
    run = bench.AnySong(bench.CHOREOGRAPHER, workers=1)
    run.folder = tmp_path
    run.dance(jobs[:2])
    times = [run.path(job).stat().st_mtime_ns for job in jobs[:2]]
    run.dance(jobs[:2])
    assert [run.path(job).stat().st_mtime_ns for job in jobs[:2]] == times
    assert Motion.load(run.path(jobs[0])).num_dancers == 1


def test_energy_is_asked_for_only_if_it_is_named(tmp_path, monkeypatch):
    asked = []

    class Model:
        def generate(self, song, **options):
            asked.append(options.get("energy"))
            return Motion(torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3))

    monkeypatch.setattr(bench, "loaded", lambda name: Model())
    song = songs.HardSong("a", "", "synthetic", songs.waltz().music.slice(0, 2), BEATS)
    for energy in (None, 1.25):
        bench.danced("x", bench.Job(song, 1, 0, energy=energy), tmp_path / "a.npz")
    assert asked == [None, 1.25]


@pytest.mark.parametrize(
    ("make", "gaps"), [(songs.waltz, [60 / 138]), (songs.tempo_change, [60 / 96, 60 / 136])]
)
def test_synthetic_songs_have_the_beats_they_name(make, gaps):
    song = make()
    assert song.music.duration == songs.SECONDS
    assert sorted(set(np.diff(song.beats).round(3)), reverse=True) == [round(g, 3) for g in gaps]
    found = song.music.beats()
    far = np.abs(found[:, None] - song.beats).min(1)
    assert len(found) == pytest.approx(len(song.beats), abs=3)
    assert (far < 0.07).mean() > 0.9


def test_rubato_has_no_beat_and_says_so():
    assert len(songs.rubato().beats) == 0


def test_levels_and_loops():
    loud = songs.louder(noise(1, np.ones_like), 60)
    assert loud.peak == 1
    assert songs.louder(loud, -40).peak == pytest.approx(0.01)
    assert songs.repeated(loud, 2.5).duration == 2.5


def test_the_liveliest_stretch_is_found():
    music = noise(60, lambda t: 0.2 + (t > 45))
    start = songs.liveliest(music, 20, bench.loudness)
    assert 30 <= start <= 40
