"""Streaming holds a segment, however long the song: what it gave away is forgotten."""

import gc
from dataclasses import dataclass

import pytest
import torch

from dancediff.generation.pipeline import pipeline_of
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

MUSIC = 35  # width of the song's features, which are known from the start and stay


@dataclass
class Tune:
    """As much of a song as `stream` looks at."""

    duration: float
    name: str = "tune"
    is_silent: bool = False
    peak: float = 0.5

    def features(self):
        return torch.zeros(1 + int(30 * self.duration), MUSIC)


def held() -> int:
    """Bytes of all tensors there are, but for the song's features."""
    gc.collect()
    tensors = [x for x in gc.get_objects() if type(x) in (torch.Tensor, torch.nn.Parameter)]
    storages = {x.untyped_storage().data_ptr(): x.untyped_storage().nbytes() for x in tensors}
    songs = {x.untyped_storage().data_ptr() for x in tensors if x.shape[-1:] == (MUSIC,)}
    return sum(size for place, size in storages.items() if place not in songs)


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 16}
    return pipeline_of(TCDiffPP(TCDiffPPConfig(**sizes, music_dim=MUSIC)))


def held_late(model, minutes, *, keep=None, **options) -> int:
    """What is held beyond what was there before, when the last piece but one is handed out."""
    before, late, frames = held(), 0, 0
    for piece in model.stream(Tune(60.0 * minutes), dancers=2, steps=1, guidance=1.0, **options):
        assert piece.root.grad_fn is None  # a graph would hold what no one can count here
        frames += piece.num_frames
        if keep is not None:
            keep.append(piece)
        if frames == 1800 * minutes - 75:  # to look takes longer than to dance
            late = held() - before
    assert frames == 1800 * minutes and late > 0
    return late


@pytest.mark.parametrize("pinning", ["renoise", "init"])
def test_four_minutes_hold_no_more_than_one(model, pinning):
    one, four = (held_late(model, minutes, pinning=pinning) for minutes in (1, 4))
    segment = 2 * 150 * 151 * 4
    assert one < 10 * segment
    assert four < one + segment / 10


def test_keeping_the_pieces_would_be_noticed(model):
    one, four = (held_late(model, minutes, keep=[]) for minutes in (1, 4))
    assert four > one + 2 * 4500 * 151 * 4
