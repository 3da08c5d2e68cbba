r"""Read arrays out of a pickle that nobody has to trust.

A pickle is a program for a small stack machine, and that program may call any Python function. The
machine here knows the few steps that build numbers, text, lists, tuples, dicts and numpy arrays. It
imports nothing: a name in the file is only compared with those of `_KNOWN`, so a file that names
anything else is refused before any of it could run.

A small file cannot ask for much memory or time either. Lengths are checked against what the file
holds, bytes that are used again and again are counted each time, keys are short and do not collide.

Read first: the documentation of Python's `pickletools`, which names the steps.
"""

import io
import pickletools
import re
from collections.abc import Callable
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np

LIMIT = 2**28  # bytes of a file; an hour of one dancer is 35 MB
MAX_STEPS = 500_000  # a step is one byte in the file, but what it makes may take a hundred
MAX_DEPTH = 50  # of nested containers

_CODES = {code.code: code for code in pickletools.opcodes}
_KNOWN = {
    "numpy ndarray": "ndarray",
    "numpy dtype": "dtype",
    "_codecs encode": "bytes",  # how Python 3 writes bytes for Python 2
    **{f"{b} {kind}": kind for b in ("builtins", "__builtin__") for kind in ("bytes", "bytearray")},
    **{
        f"numpy.{core}.{name}": name.split()[1]
        for core in ("core", "_core")  # numpy 2 renamed it
        for name in ("multiarray _reconstruct", "multiarray scalar", "numeric _frombuffer")
    },
}
_LITERALS = frozenset(
    "INT BININT BININT1 BININT2 LONG LONG1 LONG4 FLOAT BINFLOAT UNICODE BINUNICODE "
    "SHORT_BINUNICODE BINUNICODE8 STRING BINSTRING SHORT_BINSTRING BINBYTES SHORT_BINBYTES "
    "BINBYTES8 BYTEARRAY8".split()
)
_DTYPE = re.compile(r"[biufc]\d{1,2}|[SU]\d{1,9}")  # bool, integer, float, complex, bytes, text
_ESCAPE = re.compile(rb"\\(?:x([0-9a-fA-F]{2})|([\\'\"nrt]))")
_LETTERS = {b"n": b"\n", b"r": b"\r", b"t": b"\t"}


class _Name:
    """A known function or class, by its name alone."""

    def __init__(self, what: str):
        self.what = what


class _Open:
    """An array or dtype whose state has not come yet; ``value`` is what it becomes."""

    def __init__(self, what: str, spec: str = ""):
        self.what, self.spec = what, spec
        self.value: Any = None


def load_pickle(path, *, limit: int = LIMIT):
    """Read a pickle of plain containers, text, numbers and numpy arrays, by Python 2 or 3.

    Raises: ValueError naming the file and what is wrong with it: missing, larger than ``limit``
    bytes, broken, or holding anything else, of which the class is named.
    """
    path = Path(path)
    try:
        size = path.stat().st_size
        if size > limit:
            raise ValueError(f"it has {size} bytes, more than the limit={limit}; raise that")
        with path.open("rb") as file:
            return loads(file.read(size))
    except (OSError, ValueError) as err:
        raise ValueError(f"{path} cannot be read as a pickle of arrays: {err}") from err


def loads(data: bytes):
    """Read a pickle from bytes; text of Python 2 is taken as latin-1.

    Raises: ValueError telling what is wrong, and naming a class or function that is not allowed.

    >>> import pickle
    >>> loads(pickle.dumps({"root": np.zeros((2, 3)), "fps": 60}))["root"].shape
    (2, 3)
    >>> loads(pickle.dumps(print))
    Traceback (most recent call last):
    ValueError: it names 'builtins print', which is no array, number, text or plain container
    """
    stream, machine = io.BytesIO(data), _Machine(budget=4 * len(data))
    try:
        for _ in range(MAX_STEPS):
            step = _CODES.get(stream.read(1).decode("latin-1"))
            if step is None:
                raise ValueError("it is cut off, or no pickle at all")
            if step.name == "STOP":
                return machine.result()
            machine.step(step.name, stream, step.arg)
    except (IndexError, KeyError, TypeError, OverflowError, MemoryError) as err:
        raise ValueError(f"it is broken ({type(err).__name__}: {err})") from err
    raise ValueError(f"it has more than {MAX_STEPS} steps; long lists belong into arrays")


class _Machine:
    """The stack, the marks on it, the memo, and how many bytes may still be made."""

    def __init__(self, budget: int):
        self.stack: list = []
        self.marks: list[int] = []
        self.memo: dict = {}
        self.budget = budget

    def step(self, name: str, stream, argument) -> None:
        """Do one step, its argument read from the stream."""
        if name not in _LITERALS and name not in _STEPS:
            raise ValueError(f"it uses the step {name}, which arrays and containers do not need")
        read = _READERS.get(name, argument and argument.reader)
        value = read(stream) if read else None
        if name in _LITERALS:
            self.stack.append(value)
        else:
            _STEPS[name](self, value)

    def result(self):
        """What is left at the end, once it is certain to hold nothing but finished values."""
        if len(self.stack) != 1 or self.marks:
            raise ValueError("it ends in the middle of an object")
        _check(self.stack[0])
        return self.stack[0]

    def pop(self):
        """The topmost value; a mark is a floor."""
        if self.marks and len(self.stack) <= self.marks[-1]:
            raise ValueError("it takes more from the stack than there is")
        return self.stack.pop()

    def pops(self, count: int | None = None) -> list:
        """The topmost values, by default those above the last mark, which is taken away."""
        if count is not None:
            return [self.pop() for _ in range(count)][::-1]
        at = self.marks.pop()
        items = self.stack[at:]
        del self.stack[at:]
        return items

    def extend(self, items: list) -> None:
        """Put items at the end of the list on top."""
        if type(self.stack[-1]) is not list:
            raise ValueError(f"it fills a {type(self.stack[-1]).__name__} as if it were a list")
        self.stack[-1].extend(items)

    def update(self, items: list) -> None:
        """Put keys and values, in turn, into the dict on top."""
        if type(self.stack[-1]) is not dict or len(items) % 2:
            raise ValueError(f"it fills a {type(self.stack[-1]).__name__} as if it were a dict")
        for key, value in zip(items[::2], items[1::2], strict=True):
            # integers beyond 2**31 can be chosen so that all of them collide
            small = type(key) is int and key.bit_length() < 32
            if not (small or type(key) in (str, bytes, bool)):
                raise ValueError(f"it has a dict with a {type(key).__name__} as key")
            self.stack[-1][key] = value

    def put(self, index: int | None) -> None:
        """Remember the topmost value."""
        index = len(self.memo) if index is None else index
        if not 0 <= index < MAX_STEPS:
            raise ValueError(f"it remembers a value as number {index}")
        self.memo[index] = self.stack[-1]

    def get(self, index: int) -> None:
        """Bring back a remembered value, as what it has become."""
        value = self.memo[index]
        done = isinstance(value, _Open) and value.value is not None
        self.stack.append(value.value if done else value)

    def name(self, name: str) -> None:
        """Name a function or class."""
        if name not in _KNOWN:
            raise ValueError(
                f"it names {name[:100]!r}, which is no array, number, text or plain container"
            )
        self.stack.append(_Name(_KNOWN[name]))

    def call(self, function, args) -> None:
        """Make an object from what is named."""
        if (
            not isinstance(function, _Name)
            or function.what not in _CALLS
            or type(args) is not tuple
        ):
            raise ValueError("it calls something that is no function")
        self.push(_CALLS[function.what](*args))

    def build(self, target, state) -> None:
        """Finish an array or a dtype."""
        if not isinstance(target, _Open) or target.value is not None:
            raise ValueError("it gives a state to something that takes none")
        if target.what == "dtype":
            target.value = _dtype(target.spec, *state)
        else:
            _, shape, dtype, fortran, content = state
            target.value = _array(content, dtype, shape, "F" if fortran else "C")
        self.push(target.value)

    def push(self, value) -> None:
        """Put a made value on the stack, and count its bytes."""
        size = len(value) if isinstance(value, bytes | bytearray) else getattr(value, "nbytes", 0)
        self.budget -= size
        if self.budget < 0:
            raise ValueError("it makes many arrays of the same bytes")
        self.stack.append(value)


def _string(stream) -> str:
    """Text as Python 2 wrote it in protocol 0: quoted, with escapes, bytes as latin-1."""
    line = stream.readline().removesuffix(b"\n")
    if len(line) < 2 or line[:1] not in (b"'", b'"') or line[-1:] != line[:1]:
        raise ValueError(f"it has text without quotes: {line[:40]!r}")
    body = _ESCAPE.sub(
        lambda m: bytes.fromhex(m[1].decode()) if m[1] else _LETTERS.get(m[2], m[2]), line[1:-1]
    )
    return body.decode("latin-1")


def _names(stream) -> str:
    """Module and class, on two lines."""
    return " ".join(stream.readline(200).decode().removesuffix("\n") for _ in range(2))


# pickletools' own take ASCII only
_READERS: dict[str, Callable] = {"STRING": _string, "GLOBAL": _names}
_STEPS: dict[str, Callable] = {
    "PROTO": lambda m, _: None,
    "FRAME": lambda m, _: None,
    "NONE": lambda m, _: m.stack.append(None),
    "NEWTRUE": lambda m, _: m.stack.append(True),
    "NEWFALSE": lambda m, _: m.stack.append(False),
    "MARK": lambda m, _: m.marks.append(len(m.stack)),
    "POP": lambda m, _: m.pop(),
    "EMPTY_LIST": lambda m, _: m.stack.append([]),
    "LIST": lambda m, _: m.stack.append(m.pops()),
    "APPEND": lambda m, _: m.extend(m.pops(1)),
    "APPENDS": lambda m, _: m.extend(m.pops()),
    "EMPTY_TUPLE": lambda m, _: m.stack.append(()),
    "TUPLE": lambda m, _: m.stack.append(tuple(m.pops())),
    "TUPLE1": lambda m, _: m.stack.append(tuple(m.pops(1))),
    "TUPLE2": lambda m, _: m.stack.append(tuple(m.pops(2))),
    "TUPLE3": lambda m, _: m.stack.append(tuple(m.pops(3))),
    "EMPTY_DICT": lambda m, _: m.stack.append({}),
    "DICT": lambda m, _: (items := m.pops(), m.stack.append({}), m.update(items)),
    "SETITEM": lambda m, _: m.update(m.pops(2)),
    "SETITEMS": lambda m, _: m.update(m.pops()),
    **dict.fromkeys(("PUT", "BINPUT", "LONG_BINPUT", "MEMOIZE"), _Machine.put),
    **dict.fromkeys(("GET", "BINGET", "LONG_BINGET"), _Machine.get),
    "GLOBAL": _Machine.name,
    "STACK_GLOBAL": lambda m, _: m.name(" ".join(m.pops(2))),
    "REDUCE": lambda m, _: m.call(*m.pops(2)),
    "BUILD": lambda m, _: m.build(*m.pops(2)),
}


def _check(value) -> None:
    """Refuse half-made objects, bare names and endless nesting anywhere inside."""
    seen: set[int] = set()
    level = [value]
    for _ in range(MAX_DEPTH):
        inside: list = []
        for item in level:
            if isinstance(item, _Name | _Open | np.dtype):
                raise ValueError("it holds the class of an array, or one that is not finished")
            if isinstance(item, list | tuple | dict) and id(item) not in seen:
                seen.add(id(item))
                inside.extend(item.values() if isinstance(item, dict) else item)
        if not inside:
            return
        level = inside
    raise ValueError(f"it nests more than {MAX_DEPTH} containers")


def _reconstruct(cls, *_) -> _Open:
    if not (isinstance(cls, _Name) and cls.what == "ndarray"):
        raise ValueError("it holds an array of an unknown class")
    return _Open("ndarray")


def _open_dtype(spec, *_) -> _Open:
    if not isinstance(spec, str) or not _DTYPE.fullmatch(spec):
        raise ValueError(f"it holds an array of {str(spec)[:40]!r}, not of numbers or text")
    return _Open("dtype", spec)


def _dtype(spec: str, version, order, subdtype, names, fields, *_) -> np.dtype:
    parts = any(part is not None for part in (subdtype, names, fields))
    if parts or not isinstance(order, str) or order not in ("<", ">", "=", "|"):
        raise ValueError(f"it holds an array of {spec!r} with parts or an unknown byte order")
    return np.dtype(spec) if order == "|" else np.dtype(spec).newbyteorder(order)  # type: ignore[arg-type]


def _array(content, dtype, shape, order: Literal["C", "F"]) -> np.ndarray:
    """An array from its bytes, of which there must be exactly as many as its shape says."""
    content = content.encode("latin-1") if isinstance(content, str) else content
    if not (isinstance(dtype, np.dtype) and isinstance(content, bytes | bytearray)):
        raise ValueError(f"it holds an array made of a {type(content).__name__}, not of bytes")
    if type(shape) is not tuple or len(shape) > 32:
        raise ValueError("it holds an array whose shape is no tuple of lengths")
    if any(type(k) is not int or not 0 <= k <= LIMIT for k in shape):
        raise ValueError("it holds an array with a length that no array has")
    if prod(shape) * dtype.itemsize != len(content):
        raise ValueError(f"it holds an array {shape} of {dtype} in {len(content)} bytes")
    array = np.ndarray(shape, dtype, bytearray(content), order=order)
    return array if dtype.isnative else array.astype(dtype.newbyteorder("="))


def _bytes(content=b"", encoding="latin1") -> bytes:
    if isinstance(content, bytes | bytearray):
        return bytes(content)
    latin = isinstance(encoding, str) and encoding in ("latin1", "latin-1")
    if not (isinstance(content, str) and latin):
        raise ValueError("it makes bytes of something that is no latin-1 text")
    return content.encode("latin-1")


_CALLS: dict[str, Callable] = {
    "_reconstruct": _reconstruct,
    "dtype": _open_dtype,
    "scalar": lambda dtype, content: _array(content, dtype, (), "C")[()],
    "_frombuffer": _array,
    "bytes": _bytes,
    "bytearray": lambda *args: bytearray(_bytes(*args)),
}
