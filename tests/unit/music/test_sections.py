"""Sections against songs whose sections are known."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from dancediff.music.features import MFCC, NUM_FEATURES
from dancediff.music.sections import phrase_similarity, song_sections
from dancediff.music.synth import synth_song
from dancediff.music.varied import synth_varied_song

SOUND = {"quiet": -9.0, "middle": 0.0, "loud": 8.0}


def song_of(parts, beat=15) -> torch.Tensor:
    """Features of a song made of (sound, beats); of "none" the number is seconds without a beat."""
    g = torch.Generator().manual_seed(0)
    timbre = {name: 12 * torch.randn(20, generator=g) for name in SOUND}
    rows = []
    for sound, number in parts:
        part = torch.zeros(number * (30 if sound == "none" else beat), NUM_FEATURES)
        part[:, MFCC] = timbre["quiet" if sound == "none" else sound]
        part[:, MFCC.start] = SOUND["quiet" if sound == "none" else sound] * 128**0.5
        if sound != "none":
            part[::beat, 34] = 1
        rows.append(part)
    M = torch.cat(rows)
    M[:, MFCC] += torch.randn(len(M), 20, generator=g)
    return M


def labels(sections) -> list[str]:
    return [label for _, _, label in sections]


def test_the_loudest_that_returns_is_the_chorus():
    parts = [("quiet", 16), ("middle", 32), ("loud", 16), ("middle", 32), ("loud", 16)]
    found = song_sections(song_of(parts))
    assert labels(found) == ["intro", "verse", "chorus", "verse", "chorus"]
    borders = np.cumsum([beats * 0.5 for _, beats in parts])
    assert [stop for _, stop, _ in found] == pytest.approx(borders.tolist(), abs=0.1)


def test_what_never_returns_is_a_bridge_even_if_it_is_loudest():
    parts = [("middle", 16), ("quiet", 16), ("loud", 16), ("middle", 16), ("quiet", 16)]
    found = song_sections(song_of(parts))
    assert labels(found)[:4] == ["chorus", "verse", "bridge", "chorus"]


def test_stretches_without_a_beat():
    parts = [("none", 7), ("loud", 16), ("middle", 16), ("none", 5), ("loud", 16), ("none", 6)]
    found = song_sections(song_of(parts))
    assert labels(found) == ["intro", "chorus", "bridge", "break", "chorus", "outro"]
    assert found[0][1] == pytest.approx(7, abs=0.1)
    start, stop, _ = found[3]
    assert (start, stop) == pytest.approx((23, 28), abs=0.6)


def test_one_sound_throughout_is_one_verse():
    assert song_sections(song_of([("middle", 64)])) == [(0.0, 32.0, "verse")]


@pytest.mark.parametrize("beats", [0, 1, 4, 5, 8, 9])
def test_short_songs(beats):
    M = song_of([("middle", max(beats, 1))])
    if not beats:
        M[:, 34] = 0
    found = song_sections(M)
    assert found[0][0] == 0 and found[-1][1] == len(M) / 30
    assert labels(found) in (["verse"], ["break"])


def test_what_is_no_song_is_refused():
    with pytest.raises(ValueError, match="M has shape"):
        song_sections(torch.zeros(9, 3))


def score(song, truth) -> tuple[float, float]:
    """F of borders within a bar, and the share of time where chorus or not is right."""
    found = song_sections(song.features())
    assert found[0][0] == 0 and all(a[1] == b[0] for a, b in pairwise(found))
    true = [s for k, s in enumerate(truth.sections) if not k or s[2] != truth.sections[k - 1][2]]
    borders = [np.array([start for start, _, _ in s if start > 3]) for s in (found, true)]
    near = np.abs(np.subtract.outer(*borders)) <= truth.meter * 60 / truth.tempo
    F = (near.any(1).sum() + near.any(0).sum()) / max(sum(near.shape), 1)
    t = np.arange(0, song.duration, 0.1)
    chorus = [
        np.any([(t >= a) & (t < b) for a, b, w in s if w in ("chorus", "drop")] or [0 * t], axis=0)
        for s in (found, true)
    ]
    return F, float(np.mean(chorus[0] == chorus[1]))


def test_songs_whose_sections_are_known():
    for make, borders, right in ((synth_song, 0.6, 0.6), (synth_varied_song, 0.7, 0.7)):
        F, share = np.mean([score(*make(940_000 + k, seconds=60)) for k in range(6)], axis=0)
        assert F > borders and share > right, (make.__name__, F, share)


def test_fewer_beats_than_a_phrase_and_one_are_no_phrases():
    M = torch.rand(200, 35)
    for k in (0, 1, 2, 8):
        assert phrase_similarity(M, np.arange(0, 10 * k, 10)).shape == (0, 0)
    assert phrase_similarity(M, np.arange(0, 90, 10)).shape == (1, 1)
