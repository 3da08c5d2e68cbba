"""A song as a WAV file of which a browser asks for parts, made when they are asked for.

Nothing is encoded, so that sound is there at once, and nothing of a long song is held in memory.
"""

import struct

import numpy as np

MOST = 1 << 20  # bytes of an answer; a browser asks for the rest later
_HEADER = 44


class WavFile:
    """16 bits, one or two channels, at the song's own rate.

    >>> import dancediff as dd
    >>> wav = WavFile(dd.packaged_song())
    >>> wav.part(0, 4), len(wav.part(0, wav.size)) == min(wav.size, MOST)
    (b'RIFF', True)
    """

    def __init__(self, song):
        """Of a `Music`; its sound is looked up later."""
        self.song = song
        self.channels = min(song.audio.shape[1], 2)
        self._frame = 2 * self.channels
        self.size = _HEADER + len(song.audio) * self._frame

    def part(self, start: int, stop: int) -> bytes:
        """From one byte of the file to another, at most `MOST` of them."""
        stop = min(stop, self.size, start + MOST)
        head = self._head()[start:stop] if start < _HEADER else b""
        if stop <= _HEADER:
            return head
        first, last = max(start - _HEADER, 0), stop - _HEADER
        a, b = first // self._frame, -(-last // self._frame)
        audio = np.asarray(self.song.audio[a:b])[:, : self.channels]
        sound = (audio.clip(-1, 1) * 32767).astype("<i2").tobytes()
        return head + sound[first - a * self._frame : last - a * self._frame]

    def _head(self) -> bytes:
        rate, sound = self.song.rate, self.size - _HEADER
        kind = (16, 1, self.channels, rate, rate * self._frame, self._frame, 16)
        largest = 0xFFFFFFFF
        return (
            struct.pack("<4sI4s4s", b"RIFF", min(self.size - 8, largest), b"WAVE", b"fmt ")
            + struct.pack("<IHHIIHH", *kind)
            + struct.pack("<4sI", b"data", min(sound, largest))
        )


def asked_range(header: str | None, size: int) -> tuple[int, int]:
    """First byte and the one behind the last of a Range header; the whole file without one.

    Raises: ValueError for anything that lies outside the file or cannot be read.

    >>> asked_range("bytes=10-19", 100), asked_range("bytes=-5", 100), asked_range(None, 100)
    ((10, 20), (95, 100), (0, 100))
    """
    if header is None:
        return 0, size
    unit, _, span = header.partition("=")
    first, dash, last = span.strip().partition("-")
    if unit.strip() != "bytes" or not dash:
        raise ValueError(f"Range {header!r} is not understood; ask for bytes=FIRST-LAST")
    start = int(first) if first else max(size - int(last), 0)
    stop = min(int(last) + 1, size) if first and last else size
    if not 0 <= start < stop:
        raise ValueError(f"Range {header!r} lies outside of {size} bytes")
    return start, stop
