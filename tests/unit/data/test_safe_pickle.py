import os
import pickle
import re
import struct
import time
import tracemalloc

import numpy as np
import pytest

from dancediff.data.safe_pickle import load_pickle, loads

PLAIN = {
    "numbers": [0, 1, -1, 255, 65536, -(2**31), 2**40, 10**60, 0.5, -1e300, True, False, None],
    "text": ("", "dance", "Tänzer", "\n'\"\\", "\x00"),
    "bytes": [b"", b"a\xff\n", bytearray(b"ab")],
    "nested": {"a": [{"b": ((1,), (1, 2), (1, 2, 3), (1, 2, 3, 4))}], 3: [[], {}, ()]},
}
ARRAYS = [
    np.arange(24.0).reshape(2, 3, 4),
    np.asfortranarray(np.arange(6, dtype=np.float32).reshape(2, 3)),
    np.arange(10)[::2],
    np.array(3.5),
    np.zeros((0, 3)),
    np.array([True, False]),
    np.array([1 + 2j]),
    np.array(["Jazz", "Ü"]),
    np.array([b"ab", b"c"]),
    np.arange(3, dtype=">f8"),
    np.arange(3, dtype=np.uint16),
]


@pytest.mark.parametrize("protocol", range(6))
def test_plain_values_come_back(protocol):
    assert loads(pickle.dumps(PLAIN, protocol)) == PLAIN
    shared = [1]
    both = loads(pickle.dumps([shared, shared], protocol))
    assert both[0] is both[1]


@pytest.mark.parametrize("protocol", range(6))
@pytest.mark.parametrize("core", [b"numpy.core", b"numpy._core"])
def test_arrays_come_back_under_both_names_of_numpys_core(protocol, core):
    data = pickle.dumps(ARRAYS, protocol)
    if protocol < 4:  # later ones write lengths before names
        data = re.sub(rb"numpy\._?core(?=\.)", core, data)
    for ours, theirs in zip(loads(data), ARRAYS, strict=True):
        np.testing.assert_array_equal(ours, theirs)
        assert ours.dtype == theirs.dtype.newbyteorder("=")
    assert ours.flags.writeable


@pytest.mark.parametrize("protocol", range(6))
def test_numpys_scalars_come_back(protocol):
    values = [np.float32(0.1), np.int64(-3), np.bool_(True), np.str_("ab")]
    assert loads(pickle.dumps(values, protocol)) == values


def test_one_array_named_twice_is_one_array():
    array = np.arange(3)
    a, b = loads(pickle.dumps([array, array], 2))
    assert a is b


# what Python 2.7 writes for {'a': numpy.array([1.0, -2.0])}, in its protocols 0 and 2
PYTHON2 = [
    b"(dp0\nS'a'\np1\ncnumpy.core.multiarray\n_reconstruct\np2\n(cnumpy\nndarray\np3\n(I0\ntp4\n"
    b"S'b'\np5\ntp6\nRp7\n(I1\n(I2\ntp8\ncnumpy\ndtype\np9\n(S'f8'\np10\nI0\nI1\ntp11\nRp12\n"
    b"(I3\nS'<'\np13\nNNNI-1\nI-1\nI0\ntp14\nbI00\n"
    rb"S'\x00\x00\x00\x00\x00\x00\xf0?\x00\x00\x00\x00\x00\x00\x00\xc0'"
    b"\np15\ntp16\nbs.",
    b"\x80\x02}q\x00U\x01aq\x01cnumpy.core.multiarray\n_reconstruct\nq\x02cnumpy\nndarray\nq\x03"
    b"K\x00\x85q\x04U\x01bq\x05\x87q\x06Rq\x07(K\x01K\x02\x85q\x08cnumpy\ndtype\nq\tU\x02f8q\n"
    b"K\x00K\x01\x87q\x0bRq\x0c(K\x03U\x01<q\rNNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tq\x0eb"
    b"\x89U\x10\x00\x00\x00\x00\x00\x00\xf0?\x00\x00\x00\x00\x00\x00\x00\xc0q\x0ftq\x10bs.",
]


@pytest.mark.parametrize("data", PYTHON2)
def test_python_2(data):
    theirs = pickle.loads(data, encoding="latin1")
    assert loads(data)["a"].tolist() == theirs["a"].tolist() == [1, -2]
    assert loads(rb"S'\xe9\'\\\n'" + b"\n.") == "é'\\\n"


class Runs:
    def __init__(self, function, *args):
        self.call = function, args

    def __reduce__(self):
        return self.call


@pytest.mark.parametrize("protocol", range(6))
def test_code_is_refused_by_name_and_never_run(protocol, tmp_path):
    mark = tmp_path / "was here"
    for function, name in [(os.mkdir, "mkdir"), (eval, "eval"), (np.save, "save")]:
        with pytest.raises(ValueError, match=name):
            loads(pickle.dumps({"a": Runs(function, str(mark))}, protocol))
    assert not mark.exists()


class Point:
    pass


@pytest.mark.parametrize(
    ("value", "name"),
    [
        (Point(), "Point|copyreg|copy_reg"),
        ({1, 2}, "set|SET"),
        (range(3), "range"),
        (np.ma.masked_array([1]), "_mareconstruct"),
        (np.random.default_rng(0), "numpy"),
        (np.array([{}]), "O8"),
        (np.zeros(2, dtype="f4,i4"), "V8"),
        (np.array(["2024-01-01"], dtype="M8[D]"), "M8"),
    ],
)
def test_other_classes_are_named(value, name):
    for protocol in range(6):
        with pytest.raises(ValueError, match=name):
            loads(pickle.dumps(value, protocol))


def long(size: int) -> bytes:
    return struct.pack("<Q", size)


HEAD = b"\x80\x04"
ARRAY = b"cnumpy.core.multiarray\n_reconstruct\n(cnumpy\nndarray\n%sC\x01btR"
F8 = (
    b"cnumpy\ndtype\n(\x8c\x02f8\x89\x88tR(K\x03\x8c\x01<NNN"
    + 2 * b"J\xff\xff\xff\xff"
    + b"K\x00tb"
)
BOMBS = {
    "bytes of 2**60": HEAD + b"\x8e" + long(2**60) + b"a.",
    "bytearray of 2**40": HEAD + b"\x96" + long(2**40) + b"a.",
    "text of 2**31": HEAD + b"X\xff\xff\xff\x7fa.",
    "memo of 2**31": HEAD + b"Nr\xff\xff\xff\x7f.",
    "memo of 10**18": b"Np1000000000000000000\n.",
    "array begun with 10**9 rows": ARRAY % b"(J\x00\xca\x9a\x3bt" + b".",
    "array of 2**40 rows": ARRAY % b"(K\x00t"
    + b"(K\x01(\x8a\x06\0\0\0\0\0\x01t" + F8 + b"\x89C\x08" + 8 * b"a" + b"tb.",
    "array of 2**62 times 4 rows": ARRAY % b"(K\x00t"
    + b"(K\x01(\x8a\x08\0\0\0\0\0\0\0\x40K\x04t" + F8 + b"\x89C\x00tb.",
    "one megabyte, a thousand times": b"\x8e" + long(2**20) + 2**20 * b"a" + b"q\x00](" + 1000 * (
        b"c__builtin__\nbytearray\n(h\x00tR") + b"e.",
    "bytes of 2**40 zeros": b"c__builtin__\nbytearray\n(\x8a\x06\0\0\0\0\0\x01tR.",
    "ten million dicts": b"(" + 10**7 * b"}" + b"l.",
    "nested tuples as a key": b"}" + b")" + 100_000 * b"\x85" + b"Ns.",
    "doubled 100 times as a key": b"})" + 100 * b"q\x00h\x00\x86" + b"Ns.",
    "lengths of a million digits": ARRAY % b"(K\x00t" + b"(K\x01(\x8b\x00\x00\x10\x00"
    + 2**20 * b"\x11" + b"q\x05" + 30 * b"h\x05" + b"t" + F8 + b"\x89C\x00tb.",
    "a long key, again and again": b"}(\x8b\x00\x00\x10\x00" + 2**20 * b"\x11" + b"q\x05N"
    + 200_000 * b"h\x05N" + b"u.",
    "nested lists": 100_000 * b"]" + 99_999 * b"a" + b".",
    "keys that collide": b"}(" + b"".join(
        b"\x8a\x0a" + (k * (2**61 - 1)).to_bytes(10, "little") + b"N" for k in range(40_000)
    ) + b"u.",
    "memo numbers that collide": b"N" + b"".join(
        b"p%d\n" % (k * (2**61 - 1)) for k in range(40_000)
    ) + b".",
}  # fmt: skip


@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_in_little_time_and_memory(name):
    data = BOMBS[name]
    start = time.process_time()
    tracemalloc.start()
    try:
        with pytest.raises(ValueError, match=r"it |only"):
            loads(data)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 60e6 + 8 * len(data)
    assert time.process_time() - start < 10


@pytest.mark.parametrize(
    "data",
    [
        b"", b"hello", b".", b"N", b"(.", b"0.", b"NN.", b"(N0.", b"(0.", b"a.", b"]a.", b"Na.",
        b"}Ns.", b"}NNs.", b"h\x00.", b"t.", b"N\x85b.", b"cnumpy\nndarray\n.",
        b"cnumpy\ndtype\n)R.", b"NR.", b"cnumpy\ndtype\nNR.", F8 + b".", b"]" + F8 + b"a.",
        b"cnumpy\ndtype\n(\x8c\x02f8tR.", ARRAY % b"(K\x00t" + b".", b"S'a\n.", b"Sa\n.", b"I1x\n.",
        b"\x8c\x01\xff.", b"P1\n.", b"Q.", b"NN\x93.", b"\x82\x01.", b"2.", b"(inumpy\nndarray\n.",
        b"cnumpy.core.multiarray\nscalar\n(" + F8 + b"C\x01atR.",
        b"cnumpy.core.multiarray\n_reconstruct\n(NNNtR.",
    ],
)  # fmt: skip
def test_broken_pickles_are_value_errors(data):
    with pytest.raises(ValueError, match=r"\w"):
        loads(data)


def test_files(tmp_path):
    path = tmp_path / "a.pkl"
    path.write_bytes(pickle.dumps({"a": np.zeros(100)}))
    assert load_pickle(path)["a"].shape == (100,)
    with pytest.raises(ValueError, match=r"a\.pkl.*limit=100"):
        load_pickle(path, limit=100)
    path.write_bytes(pickle.dumps(print))
    with pytest.raises(ValueError, match=r"a\.pkl.*builtins print"):
        load_pickle(path)
    for missing in (tmp_path / "none.pkl", tmp_path):
        with pytest.raises(ValueError, match=re.escape(str(missing))):
            load_pickle(missing)
