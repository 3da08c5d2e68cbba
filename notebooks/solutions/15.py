"""Solutions of lesson 15."""

# %% 15.1
# What is asked for holds from the next segment on, so a wish for k pieces must be made once the k-th
# is there, and before the next one is asked for. That is what the page's knobs do, too.


def steer(begin, wishes):
    stream, pieces = begin(), []
    stream.set(**wishes.get(0, {}))
    for piece in stream:
        pieces.append(piece)
        stream.set(**wishes.get(len(pieces), {}))
    return pieces


# %% 15.2
# Hearing comes once, before the first segment, and ends with the opening: neither steps nor the
# rest of the song make it longer. Denoising comes with every segment, a step after the other.
waits = {
    "half as many steps about halve the denoising": True,
    "half as many steps halve the hearing": False,
    "a song of twice the length is heard twice as long before the first step": False,
    "the second piece waits for the hearing again": False,
}


# %% 15.3
# frames - overlap new frames are played for (frames - overlap) / 30 s, which must be at least the
# seconds that a segment takes. Rounded down: one frame more, and every piece comes a little later.
import math


def most_overlap(frames, seconds):
    return math.floor(frames - 30 * seconds)


# %% 15.4
# The median gap of the newest beats forgives one that was not found, and forgets the tempo of the
# verse. The library fits an even beat to all eight; both go on from the last one.
import numpy as np


def next_beats(past, now, until):
    T = np.median(np.diff(past[-8:]))
    beats = past[-1] + T * np.arange(1, 100)
    return beats[(beats > now) & (beats <= until)]


# %% 15.5
# Dance that is ready covers a slow moment, but it cannot be changed any more: so computing rests
# while more than the lead is ready. While the player stands still nothing is played, and everything
# behind comes later: `played` must go on from when a piece was shown, not from when it was due.
import numpy as np


def play(costs, frames, steps, lead):
    rows, ready, played = [], 0.0, 0.0
    for k, (cost, n) in enumerate(zip(costs, frames, strict=True)):
        begun = max(ready, played - lead)
        ready = begun + steps * cost
        shown = max(ready, played)
        rows.append((begun, ready, shown, steps))
        if k > 0 and ready > played:
            steps = max(steps // 2, 4)
        played = shown + n / 30
    return np.array(rows)
