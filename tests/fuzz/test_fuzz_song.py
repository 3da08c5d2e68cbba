"""Broken sound files: nothing but ValueError, no hang, no memory for sound that is not there."""

import tracemalloc

import numpy as np
import pytest
from fuzzing import fuzz, mutated, num_inputs, put

from dancediff import Music

OGG_CRC = []
for byte in range(256):
    rest = byte << 24
    for _ in range(8):
        rest = (rest << 1 ^ (0x04C11DB7 if rest >> 31 else 0)) & 0xFFFFFFFF
    OGG_CRC.append(rest)
HEAD = {"wav": 60, "flac": 90, "ogg": 400, "mp3": 400}  # bytes, where the headers are


def signed(data: bytes) -> bytes:
    """The same with right checksums in every page of an .ogg: else hardly one is looked into."""
    data, at = bytearray(data), 0
    while data[at : at + 4] == b"OggS" and at + 27 <= len(data):
        end = at + 27 + data[at + 26]
        end += sum(data[at + 27 : end])
        data[at + 22 : at + 26] = bytes(4)
        crc = 0
        for byte in data[at:end]:
            crc = (crc << 8 & 0xFFFFFFFF) ^ OGG_CRC[crc >> 24 ^ byte]
        data[at + 22 : at + 26] = crc.to_bytes(4, "little")
        at = end
    return bytes(data)


@pytest.mark.filterwarnings("ignore:song .* is cut off")
@pytest.mark.parametrize("suffix", HEAD)
def test_only_value_error(suffix, tmp_path, record_property):
    path = tmp_path / f"a.{suffix}"
    noise = np.random.default_rng(0).normal(0, 0.1, (4000, 2)).astype(np.float32)
    Music(noise, 16000, "a").save(path)
    whole = path.read_bytes()

    def read(given):
        put(path, given)
        song = Music.load(path)
        assert np.isfinite(song.audio).all()
        assert len(song.audio) < 100 * len(given)

    inputs = mutated(whole, num_inputs(), head=HEAD[suffix])
    if suffix == "ogg":
        assert signed(whole) == whole
        inputs = map(signed, inputs)
    out = fuzz(read, inputs)
    record_property("trust", f"fuzz, sound, {suffix}: {out}")
    assert out.read > 0.02 * out.tried
    assert out.refused > 0  # decoders skip what is broken, most of all in ogg


def test_a_header_that_promises_too_much_takes_no_memory(tmp_path):
    """Almost seven hours of stereo by its header, 25 samples by its length."""
    path = tmp_path / "a.wav"
    Music(np.zeros((25, 2), np.float32), 44100, "a").save(path)
    data = bytearray(path.read_bytes())
    at = data.find(b"data")
    data[4:8] = data[at + 4 : at + 8] = (0xFFFFFF00).to_bytes(4, "little")
    put(path, bytes(data))
    tracemalloc.start()  # it sees what NumPy asks for, touched or not
    try:
        song = Music.load(path)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert len(song.audio) == 25 and peak < 20e6
