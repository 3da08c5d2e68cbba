"""A long song part by part: spectra of all its frames at once would fill the memory."""

import numpy as np


def parts_of(frames: int, at_once: int) -> list[tuple[int, int]]:
    """First and last frame (not included) of each part of a song.

    >>> parts_of(5, at_once=2)
    [(0, 2), (2, 4), (4, 5)]
    """
    return [(k, min(k + at_once, frames)) for k in range(0, frames, at_once)]


def sound_of(y: np.ndarray, start: int, stop: int, *, hop: int, window: int) -> np.ndarray:
    """What spectra of frames ``start`` to ``stop`` (not included) see; zeros beyond the song.

    A frame stands in the middle of its window, every ``hop`` samples: (n,) -> (samples,).

    >>> sound_of(np.arange(1, 7), start=0, stop=2, hop=3, window=4).tolist()
    [0, 0, 1, 2, 3, 4, 5]
    """
    reach = window // 2
    first, last = start * hop - reach, (stop - 1) * hop + reach
    part = y[max(first, 0) : last]
    return np.pad(part, (max(-first, 0), max(last - len(y), 0)))
