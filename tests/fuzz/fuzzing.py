"""What the fuzz tests share: how many inputs, mutated bytes, and what a reader may do with them."""

import os
import random
import resource
import sys
import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass

LONG = os.environ.get("DANCEDIFF_TRUST") == "long"  # as `make trust` sets it
MOST_SECONDS, MOST_BYTES = 2.0, 2**30
SIZES = [  # of arrays, strings and chunks: none, one, the largest of each width, 10^12
    b"\0" * 4, b"\1\0\0\0", b"\xff" * 4, b"\xff\xff\xff\x7f", b"\0\0\0\x80", b"\xff" * 8,
    (10**12).to_bytes(8, "little"), (10**9).to_bytes(4, "little"), (10**9).to_bytes(4, "big"),
]  # fmt: skip
WORDS = [
    b"\0", b"\xff", b"9", b"-", b"[", b"]", b"{", b"}", b'"', b",", b":", b"1e999", b"NaN", b"null",
    b"../../a", b"\x80", b"999999999999",
]  # fmt: skip


def num_inputs(short: int = 1000) -> int:
    """How many inputs a test tries: 20,000 with `make trust`, fewer in `make test`."""
    return 20_000 if LONG else short


@dataclass
class Outcome:
    """What became of all inputs."""

    tried: int = 0
    read: int = 0
    refused: int = 0
    slowest: float = 0.0  # seconds of CPU time, whatever else this computer does
    grown: int = 0  # bytes that the process has become larger by

    def __str__(self):
        return (
            f"{self.tried:,} inputs: {self.refused:,} refused, {self.read:,} read; "
            f"slowest {self.slowest:.2f} s, {self.grown / 2**20:.0f} MiB more memory"
        )


def fuzz(read: Callable, inputs: Iterable, *, allowed=ValueError) -> Outcome:
    """Hand every input to ``read``: it may return or raise what is ``allowed``, soon, in little."""
    out, before = Outcome(), _largest()
    for given in inputs:
        begun = time.process_time()
        try:
            read(given)
        except allowed as err:
            assert str(err), "an error without words helps nobody"
            out.refused += 1
        else:
            out.read += 1
        out.slowest = max(out.slowest, time.process_time() - begun)
        out.tried += 1
    out.grown = _largest() - before
    assert out.slowest < MOST_SECONDS
    assert out.grown < MOST_BYTES
    return out


def put(path, content: bytes | str) -> None:
    """Write a file anew; some file systems take ten times longer to write over an old one."""
    path.unlink(missing_ok=True)
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))


def _largest() -> int:
    """The most memory that this process has had, in bytes."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (
        1 if sys.platform == "darwin" else 1024
    )


def mutated(whole: bytes, count: int, *, seed: int = 0, head: int | None = None) -> Iterable[bytes]:
    """``whole`` changed ``count`` times, in one to four places, mostly among its ``head`` bytes."""
    rng = random.Random(seed)
    for _ in range(count):
        yield mutate(rng, whole, len(whole) if head is None else head)


def mutate(rng: random.Random, whole: bytes, head: int) -> bytes:
    """One mutation: bytes, sizes and words replaced, parts gone or many times, the end cut off."""
    data = bytearray(whole)
    for _ in range(rng.randint(1, 4)):
        last = min(head, len(data)) if rng.random() < 0.9 else len(data)
        at, kind = rng.randrange(last + 1), rng.randrange(7)
        if kind == 0:
            data[at : at + 1] = bytes([rng.randrange(256)])
        elif kind == 1:
            data[at : at + 1] = bytes([(data[at] if at < len(data) else 0) ^ 1 << rng.randrange(8)])
        elif kind == 2:
            size = rng.choice(SIZES)
            data[at : at + len(size)] = size
        elif kind == 3:
            word = rng.choice(WORDS)
            data[at : at + rng.choice([0, 1, len(word)])] = word
        elif kind == 4:
            part = data[at : at + rng.randint(1, 20)]
            data[at : at + len(part)] = part * rng.choice([0, 2, 50])
        elif kind == 5 and rng.random() < 0.3:
            del data[at:]
        else:  # a part from elsewhere
            start = rng.randrange(len(data) + 1)
            part = data[start : start + rng.randint(1, 16)]
            data[at : at + len(part)] = part
    return bytes(data)
