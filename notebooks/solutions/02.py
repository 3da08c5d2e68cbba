"""Solutions of lesson 02."""


# %% 02.1
# Half of the bands get 20 decibels louder and half 20 softer, as when one tone follows another. The
# mean change is 0, so the shortcut hears nothing. The rises alone make 64 x 20 / 128 = 10.
def new_tone():
    return [[-40, -20]] * 64 + [[-40, -60]] * 64


# %% 02.2
# Gaps between beats are in frames; 30 frames are a second. The median forgives a beat the tracker
# has missed, where the mean would slow the song down.
import numpy as np


def tempo(M):
    beats = np.flatnonzero(np.asarray(M)[:, 34] > 0.5)
    return 60 * 30 / float(np.median(np.diff(beats)))


# %% 02.3
# Half as loud is 6 decibels less, everywhere. Onset strength is a difference of decibels, and peaks
# and beats come from it; chroma say how the tones share the sound. Only the first MFCC, the mean
# over all bands, still says how loud it is. For its sake every song is set to one loudness.
changes = {"onset": False, "mfcc": True, "chroma": False, "peaks": False, "beats": False}


# %% 02.4
# Features look around: an onset needs the frame before it, a beat the whole song. Computed first
# and cut afterwards, a frame has the same features in every window it is in; with the cut first,
# every slice begins with an edge that is not in the music.
def windows(sound, starts, features):
    M = features(sound)
    return [M[start : start + 150] for start in starts]


# %% 02.5
# Without drums there is no beat, but pads sound on, so there is energy. It compares levels of one
# song, and half as loud is 6 decibels less in both. How sure a beat is depends on those around it.
finds = {
    "the intro has beats": False,
    "the intro has energy 0": False,
    "the break has less energy than the drums before it": True,
    "half as loud, the song has less energy": False,
    "every beat has confidence 1": False,
}


# %% 02.6
# With the begin and the end of the song among the beats, all stretches are gaps. The threshold is
# in seconds: twice the median gap would take two missed beats for a break.
def without_beat(beats, seconds):
    found, last = [], 0.0
    for beat in [*beats, seconds]:
        if beat - last > 2.2:
            found.append((last, beat))
        last = beat
    return found


# %% 02.7
# The best choice up to a beat does not depend on what comes after it, so each frame needs only its
# best total and the beat before it. Where no earlier beat adds anything the frame is a first beat.
# The last beat is the largest total; going back from there gives all the others.
import numpy as np


def track(onset, period, tightness):
    best, before = np.array(onset, dtype=float), np.full(len(onset), -1)
    gaps = np.arange(np.ceil(period / 2), np.floor(2 * period) + 1).astype(int)
    cost = tightness * np.log(gaps / period) ** 2
    for i in range(gaps[0], len(onset)):
        totals = best[i - gaps[gaps <= i]] - cost[gaps <= i]
        k = totals.argmax()
        if totals[k] > 0:
            best[i] += totals[k]
            before[i] = i - gaps[k]
    beats = [best.argmax()]
    while before[beats[-1]] >= 0:
        beats.append(before[beats[-1]])
    return np.array(beats[::-1])
