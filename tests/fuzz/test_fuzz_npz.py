"""Broken motion files: nothing but ValueError, no hang, no memory for what is not there."""

import random
import re
import tracemalloc

import numpy as np
import pytest
import torch
from fuzzing import Outcome, fuzz, num_inputs, put

from dancediff.arrays import read_arrays
from dancediff.motion.motion import Motion

NASTY = [b"\x00", b"\xff", b"9", b"-", b"(", b")", b"{", b"'", b"\\", b",", b"O", b"e", b"\x80"]


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> bytes:
    """A small motion, as it is saved."""
    path = tmp_path_factory.mktemp("npz") / "a.npz"
    pose = torch.eye(3).expand(1, 2, 24, 3, 3)
    meta = {"name": "a", "seed": 1}
    Motion(pose, torch.zeros(1, 2, 3), contact=torch.ones(1, 2, 4), meta=meta).save(path)
    return path.read_bytes()


def mutate(rng: random.Random, whole: bytes) -> bytes:
    data = bytearray(whole)
    # the headers of the zip, its arrays and the JSON, rather than the numbers
    spots = [
        k for key in (b"PK", b"NUMPY", b"{'desc", b"shape", b"{\0\0\0") for k in find(data, key)
    ]
    for _ in range(rng.randint(1, 4)):
        at = min(rng.choice(spots) + rng.randrange(90), len(data) - 1)
        kind = rng.randrange(6)
        if kind == 0:
            data[at] = rng.randrange(256)
        elif kind == 1:
            data[at : at + 1] = rng.choice(NASTY)
        elif kind == 2:  # a size or an offset of four bytes
            data[at : at + 4] = rng.choice(
                [b"\xff" * 4, b"\0" * 4, b"\xff\xff\xff\x7f", b"\1\0\0\0"]
            )
        elif kind == 3:  # bytes gone or twice
            data[at : at + rng.randint(1, 9)] = data[at : at + rng.randint(0, 9)]
        elif kind == 4:  # a digit of a shape
            digits = [k for k in range(at, min(at + 60, len(data))) if chr(data[k]) in "0123456789"]
            if digits:
                data[rng.choice(digits)] = rng.choice(b"0123456789")
        elif rng.random() < 0.2:
            del data[at:]
    return bytes(data)


def find(data: bytes, key: bytes) -> list[int]:
    spots, at = [], data.find(key)
    while at >= 0:
        spots.append(at)
        at = data.find(key, at + 1)
    return spots


def load_mutations(rng: random.Random, whole: bytes, path, count: int) -> Outcome:
    def read(given):
        put(path, given)
        motion = Motion.load(path)
        if rng.random() < 0.1:
            assert motion.joints().shape[2] == motion.skeleton.num_joints

    return fuzz(read, (mutate(rng, whole) for _ in range(count)))


def test_only_value_error(whole, tmp_path, record_property):
    out = load_mutations(random.Random(0), whole, tmp_path / "a.npz", num_inputs())
    record_property("trust", f"fuzz, motion .npz: {out}")
    assert 0.05 < out.read / out.tried < 0.7  # neither all fatal nor all harmless


def test_the_file_is_named(whole, tmp_path):
    path = tmp_path / "a.npz"
    path.write_bytes(whole[:-30])
    with pytest.raises(ValueError, match=re.escape(str(path))):
        Motion.load(path)


def test_little_memory(whole, tmp_path):
    tracemalloc.start()  # slows everything down, so not for all of them
    try:
        load_mutations(random.Random(1), whole, tmp_path / "a.npz", 2000)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 20e6


def test_compressed_and_promised_sizes_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, a=np.zeros(10**7))  # 80 MB in 80 kB
    with pytest.raises(ValueError, match="compressed"):
        read_arrays(path)
    np.savez(path, a=np.zeros(1000))
    path.write_bytes(path.read_bytes().replace(b"(1000,), }" + 9 * b" ", b"(9999999999,), }   "))
    with pytest.raises(ValueError, match=r"BadZipFile|fill"):
        read_arrays(path)
