"""benchmarks/forced_beats.py: the true past and one's own frames, to the same music."""

import json
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from dancediff.data.choreographed import choreographed_takes
from dancediff.motion.motion import Motion
from dancediff.papers.fact.model import FACT, FACTConfig
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import forced_beats
from forced_beats import START, ForcedBeats, beats_of, dances_of


class Watched(FACT):
    """Notes the music that it hears."""

    def forward(self, history, M):
        self.heard.append(M)
        return super().forward(history, M)


@pytest.fixture(scope="module")
def take():
    return choreographed_takes(3, seconds=15, sizes=(1,))[0]


@pytest.fixture
def model():
    sizes = {"num_heads": 2, "num_layers": 1, "ff_dim": 32, "music_layers": 1, "motion_layers": 1}
    model = Watched(FACTConfig(d_model=16, **sizes))
    model.heard = []
    return model


def test_both_hear_the_music_of_the_frames_they_guess(take, model):
    found = dances_of(model, take)
    kinds = [f"{past}, {k} kept" for k in (1, 5) for past in ("true past", "own frames")]
    assert list(found) == ["truth", *kinds]
    assert {dance.num_frames for dance in found.values()} == {300 - model.history_frames}
    once, fives = 240, 48  # guesses
    heard = [torch.cat(part) for part in (model.heard[:once], model.heard[once : 2 * once])]
    heard += [torch.cat(model.heard[2 * once :][k * fives : (k + 1) * fives]) for k in (0, 1)]
    assert torch.equal(heard[0], heard[1]) and torch.equal(heard[2], heard[3])
    first, step = heard[0][0], heard[2][1]
    M = model.music_normalizer.normalize(take.M[START:])
    assert torch.equal(first, M[:120]) and torch.equal(step, M[5:125])


def test_only_what_is_on_the_beat_is_worse_beside_it():
    beats = np.arange(0.5, 13, 0.5)
    M = torch.zeros(400, 35)
    M[np.round((beats + 0.045) * 30).astype(int), 34] = 1
    take = SimpleNamespace(M=M)
    t = torch.arange(400) / 30
    root = torch.zeros(1, 400, 3)
    root[0, :, 0] = torch.cos(2 * torch.pi * t)  # turns round on every beat
    still = torch.eye(3).expand(1, 400, 24, 3, 3)
    on, beside, often, speed = beats_of(Motion(still, root).frames(100, 400), take, 0)
    assert on > 0.9 and beside < 0.4
    assert often == pytest.approx(2, abs=0.15) and speed == pytest.approx(4, rel=0.05)


def test_the_table_has_a_row_for_each_kind(take, model, tmp_path, monkeypatch):
    songs = [*choreographed_takes(3, seconds=15, sizes=(1, 2)), take]
    packed = SimpleNamespace(takes=lambda num_frames: songs)
    monkeypatch.setattr(forced_beats, "PackedTakes", lambda data, split: packed)
    monkeypatch.setattr(forced_beats.dd, "load", lambda name: SimpleNamespace(model=model))
    ForcedBeats(tmp_path, ("runs/fact_tiny-0/20min/model",), results=tmp_path).run()
    table = json.loads((tmp_path / "bench_forced.json").read_text())
    assert "1 solos" in table["about"] and len(table["columns"]) == len(table["rows"][0])
    assert [row[0] for row in table["rows"]][:2] == ["held-out dances", "20min, true past, 1 kept"]
