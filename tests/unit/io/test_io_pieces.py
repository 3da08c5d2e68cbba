"""A dance written piece by piece is the file that the whole dance would be."""

import itertools

import numpy as np
import pytest
import torch

from dancediff import hub
from dancediff.data.choreographer import choreograph
from dancediff.io.pieces import save_pieces
from dancediff.motion.motion import Motion
from tiny_tcdiffpp import tiny_tcdiffpp


@pytest.fixture(scope="module")
def dance():
    made = choreograph(np.arange(0.2, 6, 0.5), dancers=3, seed=1)[0]
    return Motion.from_features(made.features(), fps=30)  # with contacts


def cut(dance, *places):
    places = [0, *places, dance.num_frames]
    return [dance.frames(a, b) for a, b in itertools.pairwise(places)]


def test_same_bytes_as_the_whole(dance, tmp_path):
    whole = dance.save(tmp_path / "whole.npz").read_bytes()
    pieces = iter(cut(dance, 1, 40, 41, 100))
    assert save_pieces(pieces, tmp_path / "pieces.npz").read_bytes() == whole
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.parametrize("more", [{}, {"swap": (1, 0), "start": [(-1, 0), (1, 0)]}])
def test_streamed_and_saved(tmp_path, more):
    model, song = tiny_tcdiffpp(), hub.packaged_song()
    options = {"dancers": 2, "seconds": 9, "steps": 2, "seed": 3} | more
    whole = model.generate(song, **options).save(tmp_path / "whole.npz")
    pieces = save_pieces(model.stream(song, **options), tmp_path / "pieces.npz")
    assert pieces.read_bytes() == whole.read_bytes()


def test_a_failing_stream_leaves_the_old_file(dance, tmp_path):
    path = tmp_path / "dance.npz"
    path.write_text("old")

    def broken():
        yield dance
        raise RuntimeError("no power")

    with pytest.raises(RuntimeError, match="no power"):
        save_pieces(broken(), path)
    with pytest.raises(ValueError, match="no piece"):
        save_pieces([], path)
    with pytest.raises(ValueError, match="2 dancers"):
        save_pieces([dance, Motion.side_by_side([dance.dancer(0), dance.dancer(1)])], path)
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]
    with pytest.raises(ValueError, match=r"must end in \.npz"):
        save_pieces([dance], tmp_path / "dance.html")


def test_the_folder_is_made(tmp_path):
    still = Motion(torch.eye(3).expand(1, 9, 24, 3, 3), torch.zeros(1, 9, 3))
    assert save_pieces([still], tmp_path / "new" / "dance.npz").is_file()


def test_pieces_with_nan_are_not_written(tmp_path):
    still = Motion(torch.eye(3).expand(1, 9, 24, 3, 3), torch.zeros(1, 9, 3))
    lost = Motion(still.pose, torch.full((1, 9, 3), torch.nan))
    with pytest.raises(ValueError, match="not finite"):
        save_pieces([still, lost], tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())
