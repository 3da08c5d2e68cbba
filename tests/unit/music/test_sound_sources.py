"""Blocks of a song in step with a clock, and a microphone that the tests make up."""

import sys
import types

import numpy as np
import pytest

from dancediff.music.song import Music
from dancediff.music.sound_sources import microphone, played


def test_blocks_come_when_they_have_sounded():
    song, now, waits = Music(np.arange(25.0), 100), [0.0], []

    def sleep(seconds):
        waits.append(round(seconds, 6))
        now[0] += seconds

    blocks = []
    for block in played(song, clock=lambda: now[0], sleep=sleep):
        blocks.append(block)
        now[0] += 0.15 if len(blocks) == 1 else 0  # the listener is late once
    assert waits == [0.1]  # the second came at once, the third too: they had sounded
    np.testing.assert_array_equal(np.concatenate(blocks)[:, 0], np.arange(25))


def test_a_block_holds_a_sample():
    with pytest.raises(ValueError, match="block=0"):
        next(played(Music(np.zeros(9), 100), block=0.001))


def fake_sounddevice(error: Exception | None = None) -> types.ModuleType:
    module = types.ModuleType("sounddevice")
    module.PortAudioError = type("PortAudioError", (Exception,), {})
    module.closed = False

    class InputStream:
        def __init__(self, *, blocksize, callback, samplerate, channels, dtype, device):
            if error is not None:
                raise error
            self.callback, self.shape = callback, (blocksize, channels)

        def __enter__(self):
            buffer = np.empty(self.shape, np.float32)
            for value in (1, 2):  # the buffer is used again, as PortAudio does
                buffer[:] = value
                self.callback(buffer, len(buffer), None, None)
            return self

        def __exit__(self, *_):
            module.closed = True

    module.InputStream = InputStream
    return module


def test_a_microphone_gives_blocks_and_is_closed(monkeypatch):
    module = fake_sounddevice()
    monkeypatch.setitem(sys.modules, "sounddevice", module)
    blocks = microphone(1000)
    assert [next(blocks).mean() for _ in range(2)] == [1, 2]
    blocks.close()
    assert module.closed


def test_without_sounddevice_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", None)
    with pytest.raises(ImportError, match=r"dancediff\[microphone\]"):
        next(microphone())


def test_without_a_microphone_it_says_so(monkeypatch):
    monkeypatch.setitem(sys.modules, "sounddevice", fake_sounddevice(ValueError("none")))
    with pytest.raises(ValueError, match="device=7 gives no sound"):
        next(microphone(device=7))
