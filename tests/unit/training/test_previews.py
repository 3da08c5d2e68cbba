"""`dancediff train` shows five seconds of a training, of whatever size its groups may be."""

import pytest
import torch

from dancediff.cli.commands import Train
from dancediff.motion.motion import Motion
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.viz import plots
from tiny_lodge import tiny_lodge

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 16, "num_frames": 60}


def tcdiffpp(max_dancers: int) -> TCDiffPP:
    return TCDiffPP(TCDiffPPConfig(**SIZES, fusion_hidden=16, max_dancers=max_dancers))


@pytest.mark.parametrize(
    ("make", "dancers"),
    [
        (lambda: tcdiffpp(2), 2),
        (lambda: tcdiffpp(5), 3),
        (lambda: EDGE(EDGEConfig(**SIZES)), 3),
        (tiny_lodge, 3),
    ],
    ids=["two", "five", "edge", "lodge"],
)
def test_a_preview_shows_three_or_as_many_as_can_dance(make, dancers, tmp_path, monkeypatch):
    drawn = []
    monkeypatch.setattr(plots, "save_filmstrip", lambda dance, path, song: drawn.append(path))
    torch.manual_seed(0)
    Train(tmp_path / "a.toml", out=tmp_path).preview(make().eval(), 5)
    kept = Motion.load(tmp_path / "previews" / "step_000005.npz")
    assert kept.num_dancers == dancers
    assert drawn == [tmp_path / "previews" / "step_000005.png"]
