"""A song that a stream dances to while it arrives.

    song = LiveSong(microphone(22050), 22050, seconds=600)
    for piece in model.stream(song, dancers=3, seconds=600):
        ...

Read first: `dancediff.music.causal` · `dancediff.generation.stream`.
"""

import time
from collections.abc import Callable, Iterable

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.music.causal import AHEAD, CausalMusic
from dancediff.music.features import MFCC, NUM_FEATURES
from dancediff.music.mono import mono_mix
from dancediff.music.song import Music


class LiveSong:
    """Sound that is heard only as far as a dance needs it, so the same sound gives the same dance.

    - ``blocks``: samples, as `played` and `microphone` hand them out.
    - ``seconds``: how long it may last.
    - ``ahead``: by how many seconds frames are foretold. A segment of 5 s, of which the second half
      is new, is asked for ``ahead`` - 2.5 s before its new part sounds: the time to make it.

    - ``keep``: whether `slice` shall know what was heard; 4 bytes a sample.

    Memory is 4 kB a second of ``seconds``.

    Raises: ValueError for ``seconds`` that are not above 0, an ``ahead`` that is not within 0 and
    5 s, and as `CausalMusic`.

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
        keep: bool = False,
        clock: Callable[[], float] = time.monotonic,
    ):
        """Nothing is heard yet."""
        if not 0 < seconds < float("inf"):
            raise ValueError(f"seconds={seconds} must be a number above 0, such as 600")
        if not 0 <= ahead <= AHEAD:
            raise ValueError(f"ahead={ahead} must be within 0 and {AHEAD} s")
        self.music, self.duration, self.name = CausalMusic(rate), float(seconds), name
        self._blocks, self._ahead, self._heard = iter(blocks), ahead, -1
        self._kept: list[np.ndarray] | None = [] if keep else None
        self._clock, self._began = clock, float("nan")
        self._M = torch.zeros(1 + int(seconds * FPS), NUM_FEATURES)
        self._M[:, MFCC.start] = -100 * 128**0.5  # silence

    @property
    def now(self) -> float:
        """Seconds since the sound began, heard or not yet; nan before its first block."""
        return self._clock() - self._began

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
            self._hear(block)
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

    def _hear(self, block: np.ndarray) -> None:
        if np.isnan(self._began):  # a block comes when its last sample has sounded
            self._began = self._clock() - len(block) / self.music.rate
        if self._kept is not None:
            mono = np.asarray(block, np.float32)
            self._kept.append(mono_mix(mono) if mono.ndim == 2 else mono.copy())
        self.music.push(block)

    def slice(self, start: float, stop: float) -> Music:
        """What was heard from one second to another, mono; silence where nothing was heard yet.

        Raises: ValueError without ``keep``.
        """
        if self._kept is None:
            raise ValueError("what was heard was not kept; use LiveSong(..., keep=True)")
        rate = self.music.rate
        sound = np.zeros(round(stop * rate), np.float32)
        heard = np.concatenate([*self._kept, sound[:0]])[: len(sound)]
        sound[: len(heard)] = heard
        return Music(sound[round(start * rate) :], rate, self.name)

    def close(self) -> None:
        """Let go of the microphone; nothing more is heard."""
        if hasattr(self._blocks, "close"):
            self._blocks.close()
