"""Varied songs: what the plan says is what the sound does."""

import itertools

import numpy as np
import pytest

from dancediff.music.instruments import RATE
from dancediff.music.song_plan import SHARES, draw_plan
from dancediff.music.varied import play_plan, synth_varied_song

SEEDS = range(18)


def onset_of(song):
    return song.features()[:, 0].numpy()


def loudest(onset, times, reach=1):
    """The largest onset within ``reach`` frames of each time."""
    frames = np.round(np.asarray(times) * 30).astype(int)
    return np.max(
        [onset[np.clip(frames + k, 0, len(onset) - 1)] for k in range(-reach, reach + 1)], 0
    )


@pytest.fixture(scope="module")
def songs():
    return {seed: synth_varied_song(seed) for seed in SEEDS}


def test_the_same_seed_gives_the_same_samples():
    a, b, c = (synth_varied_song(s, seconds=6)[0].audio for s in (5, 5, 6))
    assert np.array_equal(a, b) and a.shape == c.shape and not np.allclose(a, c, atol=1e-3)
    assert np.isfinite(a).all() and np.abs(a).max() <= 1


def test_sections_follow_each_other_and_fill_the_song():
    for seed in range(200):
        for seconds in (1.0, 4.0, 9.5, 30.0, 120.0):
            parts = draw_plan(seed, seconds=seconds).sections
            assert parts[-1].stop == pytest.approx(seconds)
            assert all(a.stop == pytest.approx(b.start) for a, b in itertools.pairwise(parts))
            for part in parts:
                assert len(part.beats) == 0 or part.beats[0] == pytest.approx(part.start)


def test_shares_are_those_of_the_table():
    plans = [draw_plan(seed) for seed in range(1000)]
    for name, share in SHARES.items():
        found = np.mean([name in plan.traits for plan in plans])
        assert abs(found - share) < 4 * np.sqrt(share * (1 - share) / 1000)
    open_ = [any(len(p.beats) == 0 and p.label != "outro" for p in plan.sections) for plan in plans]
    assert 0.28 < np.mean(open_) < 0.42
    odd = [plan.meter != 4 for plan in plans]
    assert 0.12 < np.mean(odd) < 0.21


def test_beats_have_gaps_only_where_the_music_has_none():
    for seed in range(300):
        plan = draw_plan(seed)
        gaps = np.diff(plan.beats)
        holes = [p for p in plan.sections[1:-1] if len(p.beats) == 0]
        assert gaps.min() > 0.25 and (gaps > 2.2).sum() == len(holes)
        assert (gaps[gaps <= 2.2] < 1.35).all()
        assert set(plan.downbeats) <= set(plan.beats)
        bars = [p.beats[:: plan.meter] for p in plan.sections if len(p.beats)]
        assert plan.downbeats.tolist() == np.concatenate(bars).tolist()


def test_sound_begins_at_the_beats(songs):
    for song, truth in songs.values():
        onset, gaps = onset_of(song), np.diff(truth.beats)
        between = (truth.beats[:-1] + 0.37 * gaps)[gaps < 1.4]  # no division of a beat lies there
        assert loudest(onset, truth.beats).mean() > 3 * loudest(onset, between).mean()


def test_pads_and_noise_have_no_attacks(songs):
    seen = 0
    for seed, (song, truth) in songs.items():
        onset = onset_of(song)
        on_beat = np.median(loudest(onset, truth.beats))
        for part in draw_plan(seed).sections:
            if len(part.beats) == 0 and set(part.players) <= {"pad", "sweep"}:
                seen += 1
                inside = onset[round(part.start * 30) + 3 : round(part.stop * 30) - 3]
                assert inside.max() < 0.4 * on_beat
    assert seen >= 2


def test_free_notes_repeat_at_no_tempo():
    """The notes of a beatless piano: no interval comes back as those of a beat do."""
    spread = []
    for seed in range(90):
        plan = draw_plan(seed)
        for part in plan.sections:
            if part.players == ("free piano",) and part.stop - part.start > 6:
                sound = play_plan(plan)[round(part.start * RATE) : round(part.stop * RATE)]
                level = np.sqrt(np.convolve(sound**2, np.ones(1024) / 1024)[::512])
                rise = np.maximum(np.diff(np.log(level + 1e-3)), 0)
                times = np.flatnonzero((rise[1:-1] > 0.3) & (rise[1:-1] >= rise[2:])) * 512 / RATE
                gaps = np.diff(times)[np.diff(times) > 0.2]
                if len(gaps) > 3:
                    spread.append(gaps.std() / gaps.mean())
    assert len(spread) >= 3 and np.mean(spread) > 0.25


def test_sections_are_as_loud_as_planned(songs):
    """Verses 6 to 12 dB below the chorus, but where loudness is pressed or fades."""
    seen = 0
    for seed, (song, _) in songs.items():
        plan = draw_plan(seed)
        if {"compressed", "fade in", "fade out"} & plan.traits:
            continue
        level = {}
        for part in plan.sections:
            if len(part.beats) > 7 and part.label in ("verse", "chorus"):
                y = song.slice(part.start + 0.3, part.stop).audio
                level.setdefault((part.label, part.level[0]), 10 * np.log10(np.mean(y**2)))
        loud = [v for (label, _), v in level.items() if label == "chorus"]
        for (label, planned), found in level.items():
            if label == "verse" and loud and planned > -20:
                seen += 1
                assert found - loud[0] == pytest.approx(planned, abs=2.5)
    assert seen >= 8


def test_fades_begin_and_end_in_silence():
    for seed in range(200):
        plan = draw_plan(seed, seconds=20)
        if plan.traits & {"fade in", "fade out"} == {"fade out"}:
            break
    y = play_plan(plan)
    end, middle = y[-RATE // 2 :], y[len(y) // 2 - RATE : len(y) // 2]
    assert np.sqrt(np.mean(end**2)) < 0.1 * np.sqrt(np.mean(middle**2))


@pytest.mark.parametrize("bad", [{"seconds": 0.5}, {"tempo": 20.0}, {"tempo": 300.0}])
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=f"{next(iter(bad))}="):
        synth_varied_song(0, **bad)
