"""Broken BVH text: nothing but ValueError, no hang, no memory for frames that are not there."""

import random
import tracemalloc

import torch
from fuzzing import fuzz, num_inputs

from dancediff.data.bvh import read_bvh

SMALL = """HIERARCHY
ROOT hip
{
OFFSET 0 0 0
CHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation Yrotation
JOINT leg
{
OFFSET 10 -40 0
CHANNELS 3 Zrotation Xrotation Yrotation
End Site
{
OFFSET 0 -40 0
}
}
}
MOTION
Frames: 2
Frame Time: 0.033333
0 100 0 0 10 0 0 20 0
0 101 0 0 12 0 0 22 0
"""
NASTY = ["", "nan", "inf", "-1", "1e308", "999999999999", "1e-320", "{", "}", "JOINT x", "ROOT y",
         "End Site", "CHANNELS 0", "OFFSET", "MOTION", "\x00", "٣", "é", "0x10", "1_0"]  # fmt: skip


def mutate(rng: random.Random) -> str:
    text = SMALL
    for _ in range(rng.randint(1, 3)):
        kind = rng.randrange(6)
        words, lines = text.split(" "), text.split("\n")
        at, line = rng.randrange(len(text) + 1), rng.randrange(len(lines))
        if kind == 0:  # another character
            text = (
                text[:at] + chr(rng.choice([0, 9, 10, 32, 45, 48, 57, 123, 125])) + text[at + 1 :]
            )
        elif kind == 1:  # another word
            words[rng.randrange(len(words))] = rng.choice(NASTY)
            text = " ".join(words)
        elif kind == 2:  # a number of the last lines, or of the header
            text = text.replace(rng.choice(["2\n", "0.033333", "6 X", "100"]), rng.choice(NASTY), 1)
        elif kind == 3:  # cut off
            text = text[:at]
        elif kind == 4:  # a line twice, or gone
            lines[line : line + 1] = [lines[line]] * rng.choice([0, 2, 50])
            text = "\n".join(lines)
        else:  # lines swapped
            other = rng.randrange(len(lines))
            lines[line], lines[other] = lines[other], lines[line]
            text = "\n".join(lines)
    return text


def read(text):
    bvh = read_bvh(text + "\n")
    assert torch.isfinite(bvh.world()[0]).all()
    assert bvh.num_frames * len(bvh.names) < 2000


def test_only_value_error(record_property):
    rng = random.Random(0)
    tracemalloc.start()
    try:
        out = fuzz(read, (mutate(rng) for _ in range(num_inputs())))
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    record_property("trust", f"fuzz, BVH: {out}")
    assert peak < 50e6
    assert out.read > 0.01 * out.tried  # the mutations are not all fatal, and
    assert out.refused > 0.5 * out.tried  # not all harmless
