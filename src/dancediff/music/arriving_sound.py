"""Sound as it arrives, cut into frames of dance.

Read first: `dancediff.music.sound_rate`.
"""

from collections.abc import Iterator

import numpy as np

from dancediff.music.mono import mono_mix, turned_round
from dancediff.music.sound_rate import HOP, SAMPLE_RATE, whole_rate

_A_SECOND = 100  # parts that the resampler gets, so that its answer does not hang on the blocks


class ArrivingSound:
    """Mono sound at 15,360 Hz in parts of one frame, from blocks of any length and any rate.

    The resampler sees 40 ms ahead at most; a frame comes so much after its last sample.

    Raises: ValueError for another rate than a positive whole one, and for blocks that are no rows
    of finite numbers.

    >>> sound = ArrivingSound(15360)
    >>> [len(frame) for frame in sound.push(np.zeros((1100, 2)))], len(list(sound.push([0.0] * 9)))
    ([512, 512], 0)
    """

    def __init__(self, rate: int):
        import soxr

        rate = whole_rate(rate)
        self._part = max(1, rate // _A_SECOND)
        self._waiting, self._ready = np.zeros((2, 0), np.float32)
        self._resampler = None
        if rate != SAMPLE_RATE:
            self._resampler = soxr.ResampleStream(
                rate, SAMPLE_RATE, 1, dtype="float32", quality="HQ"
            )

    def push(self, samples) -> Iterator[np.ndarray]:
        """The frames that a block completes, each (512,); samples (n,) or (n, channels)."""
        block = np.asarray(samples, dtype=np.float32)
        if block.ndim == 2 and block.shape[1] and not turned_round(block.shape):
            block = mono_mix(block)
        if block.ndim != 1 or not np.isfinite(block).all():
            raise ValueError(
                f"samples with shape {np.shape(samples)} must be finite numbers, (n,) or "
                "(n, channels), not (channels, n)"
            )
        self._ready = np.concatenate([self._ready, self._resampled(block)])
        while len(self._ready) >= HOP:
            frame, self._ready = self._ready[:HOP], self._ready[HOP:]
            yield frame

    def _resampled(self, block: np.ndarray) -> np.ndarray:
        if self._resampler is None:
            return block
        self._waiting = np.concatenate([self._waiting, block])
        whole = len(self._waiting) // self._part * self._part
        parts, self._waiting = np.split(self._waiting, [whole])
        out = [self._resampler.resample_chunk(part) for part in parts.reshape(-1, self._part)]
        return np.concatenate([np.zeros(0, np.float32), *out])
