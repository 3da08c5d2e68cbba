import numpy as np
import pytest

from dancediff.music.frame_parts import parts_of, sound_of


@pytest.mark.parametrize("samples", [0, 1, 700, 5000])
def test_parts_see_what_the_whole_song_padded_by_half_a_window_holds(samples):
    hop, window = 256, 1024
    y = np.random.default_rng(0).normal(size=samples)
    whole, frames = np.pad(y, window // 2), 1 + samples // hop
    for start, stop in parts_of(frames, at_once=3):
        part = sound_of(y, start, stop, hop=hop, window=window)
        assert len(part) == (stop - start - 1) * hop + window
        assert np.array_equal(part, whole[start * hop :][: len(part)])
