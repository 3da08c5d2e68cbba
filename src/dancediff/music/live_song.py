"""A song that a stream dances to while it arrives.

    song = LiveSong(microphone(22050), 22050, seconds=600)
    for piece in model.stream(song, dancers=3, seconds=600):
        ...

Read first: `dancediff.music.causal` · `dancediff.generation.stream`.
"""

from collections.abc import Iterable

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.music.causal import AHEAD, CausalMusic
from dancediff.music.features import MFCC, NUM_FEATURES


class LiveSong:
    """Sound that is heard only as far as a dance needs it, so the same sound gives the same dance.

    - ``blocks``: samples, as `played` and `microphone` hand them out.
    - ``seconds``: how long it may last.
    - ``ahead``: by how many seconds frames are foretold. A segment of 5 s, of which the second half
      is new, is asked for ``ahead`` - 2.5 s before its new part sounds: the time to make it.

    Memory is 4 kB a second of ``seconds``.

    Raises: ValueError for an ``ahead`` that is not within 0 and 5 s, and as `CausalMusic`.

    >>> song = LiveSong([np.zeros(15360)] * 9, 15360, seconds=8)
    >>> song.features_until(150).shape, song.music.now
    (torch.Size([241, 35]), 2.0)
    """

    is_silent, peak = False, 1.0  # nobody knows yet

    def __init__(
        self,
        blocks: Iterable[np.ndarray],
        rate: int,
        *,
        seconds: float = 600.0,
        ahead: float = 3.5,
        name: str = "live",
    ):
        """Nothing is heard yet."""
        if not 0 <= ahead <= AHEAD:
            raise ValueError(f"ahead={ahead} must be within 0 and {AHEAD} s")
        self.music, self.duration, self.name = CausalMusic(rate), float(seconds), name
        self._blocks, self._ahead, self._heard = iter(blocks), ahead, -1
        self._M = torch.zeros(1 + int(seconds * FPS), NUM_FEATURES)
        self._M[:, MFCC.start] = -100 * 128**0.5  # silence

    @property
    def tempo(self) -> float:
        """Beats per minute as far as one can tell; nan before."""
        return self.music.tempo

    def beats(self) -> np.ndarray:
        """Seconds of the beats of the last 20 s, and of those to come."""
        return self.music.beats()

    def features_until(self, frame: int) -> Tensor:
        """All frames, (f, 35), once enough is heard to foretell those before ``frame``.

        Frames that cannot be foretold yet are silence; so is what comes 5 s after the sound's end.
        """
        while self.music.num_frames < frame - self._ahead * FPS:
            block = next(self._blocks, None)
            if block is None:
                break
            self.music.push(block)
        if self._heard != self.music.num_frames:
            self._heard, first = self.music.num_frames, self.music.first_frame
            self._M = self._M.clone()  # who holds the one before can tell that it is another
            last = min(self._heard + AHEAD * FPS, len(self._M))
            if first < last:
                self._M[first:last] = self.music.window(first, last - first)
        return self._M

    def features(self) -> Tensor:
        """What is known of all frames now, (f, 35)."""
        return self.features_until(0)
