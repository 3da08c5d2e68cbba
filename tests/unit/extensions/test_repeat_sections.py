from itertools import pairwise

import numpy as np
import torch

from dancediff.extensions.repeat_sections import find_sections, sections_of
from dancediff.music.features import dance_frames
from dancediff.music.sections import phrase_similarity
from dancediff.music.synth import synth_song


def song_of(labels, beat=15, noise=0.3):
    """Features of a song of 8-beat phrases; the same label is the same music, but for noise."""
    g = torch.Generator().manual_seed(0)
    material = {label: torch.randn(8 * beat, 35, generator=g) for label in sorted(set(labels))}
    M = torch.cat([material[label] for label in labels] + [torch.zeros(1, 35)])
    M += noise * torch.randn(M.shape, generator=g)
    M[:, 33:] = 0
    M[::beat, 34] = 1
    return M


def test_what_returns_is_found():
    found = find_sections(song_of("aabbcab"))
    starts = [0, 239, 479, 599, 719, 839]  # beats of a dance are a frame before those of features
    assert [(s.start, s.stop) for s in found] == list(pairwise(starts))
    assert [s.times for s in found] == [0, 0, 0, 1, 1]
    assert found[0].label == found[3].label and found[3].mirrored and not found[0].mirrored


def test_a_loop_is_one_section_and_nothing_returns():
    assert [(s.start, s.stop, s.times) for s in find_sections(song_of("aaaa"))] == [(0, 479, 0)]


def test_the_cue_on_a_section_s_first_beat_is_that_section_s():
    song = song_of("aabbaa")
    borders = {frame for s in find_sections(song) for frame in (s.start, s.stop)}
    assert borders - {0} <= set(dance_frames(song).tolist())


def test_new_material_is_never_a_return():
    assert [s.times for s in find_sections(song_of("abcdef"))] == [0] * 6


def test_songs_without_beats_have_no_sections():
    assert find_sections(song_of("ab")[:200]) == []
    M = song_of("abab")
    M[:, 34] = 0
    assert find_sections(M) == []


def test_third_time():
    assert [s.times for s in sections_of("ababa", range(6))] == [0, 0, 1, 1, 2]


def test_choruses_of_a_whole_song_sound_alike_and_verses_do_not():
    song, truth = synth_song(3, seconds=55, tempo=120)
    M = song.features()
    beats = np.flatnonzero(M[:, 34].numpy())
    S = phrase_similarity(M, beats)
    middle = beats[4::8][: len(S)] / 30
    label = [next((w for a, b, w in truth.sections if a <= t < b), "") for t in middle]
    pairs = [(i, j) for i in range(len(S)) for j in range(i)]
    other = [S[i, j].item() for i, j in pairs if label[i] != label[j]]
    assert max(other) < 0.6
    found = find_sections(M)
    for s in found:
        times = [w for t, w in zip(middle, label, strict=True) if s.start <= t * 30 < s.stop]
        assert len(set(times)) == 1  # no section holds two kinds of music
    assert sum(s.times > 0 for s in found) >= 2
