"""What benchmarks/causal_beats.py measures, on a song whose beats are known."""

import sys

import numpy as np
import pytest
import torch

from dancediff.music.features import MFCC, ONSET
from dancediff.music.synth import synth_song
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import causal_beats as bench
from beats import f_score


def test_a_song_is_known_as_it_plays():
    song, truth = synth_song(920_004, seconds=14)
    heard = bench.listen(song)
    scores = [f_score(np.array(one.times), truth.beats) for one in heard.foretold]
    assert len(scores) == 3 and min(scores) > 0.6
    W, coming, M = torch.cat(heard.known), torch.cat(heard.coming), song.features()
    assert abs(len(W) - len(M)) < 6 and len(coming) == len(W) + 30
    assert bench.correlation(W, M, ONSET) > 0.95
    assert bench.correlation(coming, M, ONSET) < bench.correlation(W, M, ONSET)
    assert 0 < heard.cost


def test_a_part_has_the_features_of_its_song():
    song = synth_song(920_004, seconds=8)[0]
    part = bench.Part(song, 2.0, 3.0)
    assert part.duration == pytest.approx(3) and torch.equal(part.M, song.features()[60:151])


def test_correlation_leaves_out_what_never_changes():
    M = torch.rand(300, 35, generator=torch.Generator().manual_seed(0))
    W = M.clone()
    W[:, MFCC.start] = 1
    assert bench.correlation(W, M, MFCC) == pytest.approx(1)


def test_songs_are_spread_over_a_folder(tmp_path):
    for k in range(10):
        (tmp_path / f"{k}.ogg").touch()
    (tmp_path / "list.txt").touch()
    assert [path.stem for path in bench.songs_of(tmp_path, 4)] == ["0", "2", "5", "7"]
    assert len(bench.songs_of(tmp_path, 20)) == 10


def test_cells_and_means_know_what_is_missing():
    assert bench.mean([1.0, None, 3.0]) == 2 and bench.mean([None]) is None
    assert bench.cells(["a", 0.126, None]) == ["a", 0.13, None]
