"""Solutions of lesson 00."""

# %% 00.1
# The only chance in the machine is the noise that the dance starts from and is stirred with, and
# the seed fixes all of it. Another song is another condition M, so the noise is cleared away
# towards another dance.
same_dance = {"same seed again": True, "another seed": False, "another song": False}

# %% 00.2
# The noise that is cleared is the whole dance: all dancers and all frames at once, so one guess
# says everything about all of them. Only the steps say how often the network guesses. More than
# five seconds are danced in segments (lesson 10), and each segment is cleared by itself.
more_guesses = {"twice the steps": 2, "twice the dancers": 1, "twice the seconds": 1}


# %% 00.3
# A second has `rate` samples, so a moment is a sample number, rounded. A drum is as short as a
# cosine that dies away; added at its place, it is over before the next one. The last bar is what
# np.zeros has left there: silence is made by doing nothing.
import numpy as np


def make_song(bpm, bars, rate):
    def drum(loud, pitch, decay):
        s = np.arange(round(0.15 * rate)) / rate
        return loud * np.cos(2 * np.pi * pitch * s) * np.exp(-s / decay)

    beat = 60 / bpm
    song = np.zeros(round(4 * bars * beat * rate))
    kick, click = drum(0.9, 60, 0.03), drum(0.3, 1000, 0.01)
    for k in range(4 * (bars - 1)):
        for when, sound in ((k * beat, kick), ((k + 0.5) * beat, click)):
            first = round(when * rate)
            song[first : first + len(sound)] += sound
    return song
