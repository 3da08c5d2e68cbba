"""Broken pickles: nothing but ValueError, nothing run, no hang, no memory for what is not there."""

import pickle
import random
import tracemalloc

import numpy as np
from fuzzing import fuzz, num_inputs

from dancediff.data.aioz import read_poses
from dancediff.data.safe_pickle import loads

VALUE = {
    "smpl_poses": np.zeros((1, 2, 72), dtype=np.float32),
    "root_trans": np.ones((1, 2, 3)),
    "meta": {"orig_start": 0, "orig_end": np.int64(2), "names": ["a", ("b", None, 0.5)]},
}
WHOLE = [pickle.dumps(VALUE, protocol) for protocol in range(6)]
NASTY = [  # steps that a mutation by single bytes would hardly find
    b"cos\nsystem\n", b"cbuiltins\neval\n", b"c__builtin__\nbytearray\n", b"(", b"R", b"b", b"o",
    b"i", b"\x81", b"\x92", b"2", b"0", b"1", b"t", b"\x85", b"d", b"}", b"]", b"a", b"e", b"s",
    b"u", b"h\x00", b"r\xff\xff\xff\x7f", b"p9999999999999\n", b"\x94",
    b"\x8e\xff\xff\xff\xff\0\0\0\0",
    b"X\xff\xff\xff\x7f", b"\x96\xff\xff\xff\xff\xff\0\0\0", b"I99999999999\n", b"S'\\x\n", b"Vx\n",
    b"L9999999999L\n", b"\x8b\xff\xff\xff\x7f", b"\x93", b"\x95\xff\xff\xff\xff\xff\xff\xff\x7f",
    b"Pid\n", b"Q", b"\x82\x01", b"\x97", b"\x98", b"G\x7f\xf0\0\0\0\0\0\0", b".",
]  # fmt: skip


def mutate(rng: random.Random) -> bytes:
    data = bytearray(rng.choice(WHOLE))
    for _ in range(rng.randint(1, 4)):
        at, kind = rng.randrange(len(data) + 1), rng.randrange(6)
        if kind == 0:
            data[at : at + 1] = bytes([rng.randrange(256)])
        elif kind == 1:
            data[at:at] = rng.choice(NASTY)
        elif kind == 2:
            data[at : at + 1] = rng.choice(NASTY)
        elif kind == 3 and rng.random() < 0.3:
            del data[at:]
            data += b"." * rng.randrange(2)
        elif kind == 4:  # a part of another one
            other = rng.choice(WHOLE)
            start = rng.randrange(len(other))
            data[at:at] = other[start : start + rng.randint(1, 60)]
        else:  # a part gone, or many times
            part = data[at : at + rng.randint(1, 20)]
            data[at : at + len(part)] = part * rng.choice([0, 2, 100])
    return bytes(data)


def test_only_value_error(record_property):
    rng = random.Random(0)
    tracemalloc.start()
    try:
        inputs = (mutate(rng) for _ in range(num_inputs()))
        out = fuzz(lambda given: read_poses(loads(given)), inputs)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    record_property("trust", f"fuzz, pickle: {out}")
    assert peak < 20e6
    assert out.read > 0.01 * out.tried  # the mutations are not all fatal, and
    assert out.refused > 0.5 * out.tried  # not all harmless
