"""Who is told to start, or to end, far outside comes and goes in steps, not in leaps.

Nor does anybody leap where the dance goes on elsewhere in the song.
"""

import numpy as np
import pytest
import torch

import dancediff as dd


@pytest.mark.parametrize(("name", "frame"), [("start", 0), ("end", -1)])
def test_no_leap_from_a_place_far_outside(name, frame):
    """When only the frame itself was given, outer dancers left it by 34 cm a frame."""
    places = [(-3.0, 0.0), (0.0, 0.0), (3.0, 0.0)]
    ask = {"dancers": 3, "seconds": 5, "seed": 0, name: places}
    dance = dd.load("tcdiffpp").generate(dd.packaged_song(), **ask)
    off = dance.root[:, frame, [0, 2]] - torch.tensor(places)
    assert off.abs().max() < 0.01
    assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.08


def test_no_leap_to_and_from_a_formation_while_dancing():
    """When only the last frame was given, steps reached 15 cm."""
    stream = dd.load("tcdiffpp").stream(dd.packaged_song(), dancers=3, seed=1, seconds=15)
    pieces = []
    for piece in stream:
        pieces.append(piece.root)
        if len(pieces) in (2, 4):
            far = [(-3.0, 0.0), (0.0, 0.5), (3.0, 0.0)]
            stream.set(formation=far if len(pieces) == 2 else None)
    assert torch.cat(pieces, 1).diff(dim=1).norm(dim=-1).max() < 0.1


def test_no_leap_where_the_dance_goes_on_elsewhere_in_the_song():
    stream = dd.load("tcdiffpp").stream(dd.packaged_song(), dancers=3, seed=1, seconds=12, steps=2)
    pieces = []
    for piece in stream:
        pieces.append(piece.root)
        if len(pieces) == 1:
            stream.seek(8.0)
        if len(pieces) == 4:
            break
        if stream.is_over:
            stream.seek(2.0)
    steps = torch.cat(pieces, 1).diff(dim=1).norm(dim=-1)
    joins = np.cumsum([piece.shape[1] for piece in pieces[:-1]]) - 1
    assert steps[:, joins].max() < 4 * steps.median(1).values.max()
