"""Sound too long for memory: samples stay in their file until somebody asks for them.

Two hours in stereo are 2.5 GB as numbers; their file is a tenth of that, or less.
"""

import hashlib
import itertools
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from dancediff.music.mono import mono_mix

SOUND_SUFFIXES = (".wav", ".flac", ".ogg", ".mp3")  # of songs that are read and written
AT_ONCE = 1 << 20  # sample times that are read at a time


class SoundOnDisk:
    """The samples (n, channels) float32 of a sound file, read where they are asked for.

    It is read once to the end at first: what a file's header says about its length is not believed.

    Raises: ValueError when the file is another one by the time they are asked for; what soundfile
    raises for files that it cannot read.

    >>> import soundfile, tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder) / "a.wav"
    ...     soundfile.write(path, np.zeros((9, 2)), 44100)
    ...     sound = SoundOnDisk(path)
    ...     sound.shape, sound[2:5].shape, sound.peak
    ((9, 2), (3, 2), 0.0)
    """

    dtype = np.dtype(np.float32)
    ndim = 2

    def __init__(self, path):
        import soundfile

        self.path = Path(path)
        self._stamp = self._look()
        frames, self.peak, self.is_finite = 0, 0.0, True
        with soundfile.SoundFile(path) as file:
            self.rate, channels = file.samplerate, file.channels
            while len(part := file.read(AT_ONCE, dtype="float32", always_2d=True)):
                self.is_finite &= bool(np.isfinite(part).all())
                frames += len(part)
                self.peak = max(self.peak, float(np.abs(mono_mix(part)).max()))
        self.shape = (frames, channels)

    def _look(self) -> tuple[int, int]:
        facts = self.path.stat()
        return facts.st_size, facts.st_mtime_ns

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, part: slice) -> np.ndarray:
        """The samples from one place to another, (k, channels)."""
        start, stop, step = part.indices(len(self))
        if step != 1:
            raise ValueError(f"step={step}: samples on disk are read one after the other")
        parts = list(self.blocks(start, stop))
        return np.concatenate(parts) if parts else np.zeros((0, self.shape[1]), np.float32)

    def __array__(self, dtype=None, copy=None) -> np.ndarray:
        return self[:].astype(dtype or self.dtype, copy=False)

    def blocks(self, start: int = 0, stop: int | None = None) -> Iterator[np.ndarray]:
        """One part after the other, each (k, channels)."""
        import soundfile

        if not self.path.exists() or self._look() != self._stamp:
            raise ValueError(f"song {str(self.path)!r} has changed since it was loaded; load again")
        left = (len(self) if stop is None else stop) - start
        with soundfile.SoundFile(self.path) as file:
            file.seek(start)
            while left > 0:
                part = file.read(min(left, AT_ONCE), dtype="float32", always_2d=True)
                if not len(part):
                    raise ValueError(f"song {str(self.path)!r} ends early; load it again")
                left -= len(part)
                yield part

    def digest(self) -> bytes:
        """A short number that is another one for other samples."""
        digest = hashlib.sha256()
        for block in self.blocks():
            digest.update(np.ascontiguousarray(block).data)
        return digest.digest()

    def mono(self, rate: int) -> np.ndarray:
        """Mean of the channels, resampled, (n,) float32."""
        import soxr

        y = np.zeros(int(np.ceil(len(self) * rate / self.rate)), np.float32)
        resampler = soxr.ResampleStream(self.rate, rate, 1, dtype="float32", quality="HQ")
        filled = 0
        for block in itertools.chain(self.blocks(), [np.zeros((0, 1), np.float32)]):
            part = resampler.resample_chunk(mono_mix(block), last=not len(block))
            part = part[: len(y) - filled]
            y[filled : filled + len(part)] = part
            filled += len(part)
        return y
