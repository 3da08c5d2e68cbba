r"""Beats of music that still goes on: what the tracker of whole songs would say of it so far.

The model is that of `dancediff.music.beat_tracking`, with the same tempi, so it takes the same
octave. Its scores only look back, so they are carried on from frame to frame. What differs is the
strength of an onset: it is compared with those before it, not with those around it.

Read first: `dancediff.music.beat_tracking` · Krebs, Böck and Widmer 2015, section 3 (the states) ·
Rabiner 1989, "A tutorial on hidden Markov models", eq. 33 (best score of what was seen so far).

Symbols (axes: f frames at 60 a second · i j tempi)
    a      activation: how strong the onset of a frame is, beside those before      within 0..1
    E      best score of everything before f, if an interval tau_i ends there       (i,)
    D      best score of everything before f, if an interval tau_i begins there     (i,)
    R      best score of everything before f, if f has no beat
"""

from collections import deque

import numpy as np
from scipy.ndimage import uniform_filter1d

from dancediff.music import beat_tracking as whole
from dancediff.music.beat_tracking import BEAT_FPS, Tempi, TrackedBeats, centres, log_likelihoods

PAST = 20  # seconds whose beats are kept
EAGER = 4.0  # nats: a beat that is so much less likely than none is believed already
_LOUD = 60  # seconds whose strongest onsets say what a quiet part is


class Activation:
    """How strong each onset is beside those of the four seconds before it.

    >>> activation = Activation()
    >>> [round(activation.push(onset), 3) for onset in (0.0, 1.0, 0.0)]
    [0.003, 0.95, 0.003]
    """

    def __init__(self):
        seconds = int(whole.SURROUNDINGS * BEAT_FPS)
        self._onsets: deque[float] = deque(maxlen=seconds)
        self._rises: deque[float] = deque(maxlen=seconds)
        self._strongest: deque[float] = deque(maxlen=_LOUD)  # one a second
        self._frames, self._floor = 0, 0.0

    def push(self, onset: float) -> float:
        """The activation of the next frame."""
        self._onsets.append(onset)
        rise = max(onset - sum(self._onsets) / len(self._onsets), 0.0)
        self._rises.append(rise)
        strongest = max(self._rises)
        if self._frames % BEAT_FPS == 0:
            self._strongest.append(strongest)
            self._floor = whole.QUIET * float(np.quantile(self._strongest, 0.9)) + 1e-9
        self._frames += 1
        return min(max(rise / max(strongest, self._floor), whole.LEAST), 0.95)


class OnlineBeats:
    r"""The most likely beats of an onset envelope that comes frame by frame.

    $$E_{f,i} = D_{f-\tau_i,\,i} + S_{f-\tau_i,\,i}, \qquad
    D_{f,i} = \max\big(\max_j E_{f,j} + \log p_{j \to i},\; R_f + \log p_{\text{start}}\big)$$

    The interval under way is judged by the part of it that was heard. Memory is that of 20 s.

    Source: ours; the recursion of `dancediff.music.beat_tracking.track_beats`, run forward only.

    >>> tracker = OnlineBeats()
    >>> for f in range(600):
    ...     tracker.push(float(f % 30 == 0))                      # 120 beats a minute
    >>> tracker.beats().times[-3:].round(2).tolist()
    [8.51, 9.01, 9.51]
    """

    def __init__(self):
        self._tempi, self._activation = Tempi(), Activation()
        self._start = np.log(whole.SWITCH / len(self._tempi.tau))
        # rings: what happened at frame f stands at f modulo their length
        self._length = 2 * int(self._tempi.tau.max())
        self._kept, tempi = PAST * BEAT_FPS, len(self._tempi.tau)
        self._a = np.full(self._kept, whole.LEAST)
        self._on, self._off, self._none = np.zeros((3, self._kept))  # sums before each frame
        self._D = np.full((self._length, tempi), -np.inf)
        self._before = np.full((self._kept, tempi), -1)  # the tempo that ended, -1: there was none
        self._stopped = np.full(self._kept, -1)  # the tempo with which the beat stopped
        self.frames, self._R = 0, 0.0
        self._interval_may_begin()

    def push(self, onset: float) -> None:
        """Hear one frame more."""
        a, f = self._activation.push(onset), self.frames
        self._a[f % self._kept] = a
        after = (f + 1) % self._kept
        on, off, none = log_likelihoods(a)
        self._on[after] = self._on[f % self._kept] + on
        self._off[after] = self._off[f % self._kept] + off
        self._none[after] = self._none[f % self._kept] + none
        self._R += none
        self.frames += 1
        self._interval_may_begin()

    def _heard(self, begin: np.ndarray) -> np.ndarray:
        """Log-likelihood of what was heard of intervals of each tempo since they began."""
        kept, now = self._kept, self.frames
        middle = np.minimum(begin + self._tempi.on_beat, now)
        on = self._on[middle % kept] - self._on[begin % kept]
        return on + self._off[now % kept] - self._off[middle % kept]

    def _interval_may_begin(self) -> None:
        """D and R of this frame, and what led to them."""
        tempi, f = self._tempi, self.frames
        every = np.arange(len(tempi.tau))
        begin = np.maximum(f - tempi.tau, 0)
        E = self._D[begin % self._length, every] + self._heard(begin) + tempi.usual
        E[tempi.tau > f] = -np.inf
        scores = E[:, None] + tempi.change
        j = scores.argmax(0)
        begins = self._R + self._start
        self._before[f % self._kept] = np.where(begins > scores[j, every], -1, j)
        self._D[f % self._length] = np.maximum(scores[j, every], begins)
        stops = E.max() + np.log(whole.SWITCH)
        self._stopped[f % self._kept] = E.argmax() if stops > self._R else -1
        self._R = max(self._R, stops)

    def _under_way(self) -> tuple[float, int, int]:
        """Score, first frame and tempo of the most likely interval that is not over yet."""
        tempi, since = self._tempi, np.arange(self._tempi.tau.max())[:, None]
        begin = np.maximum(self.frames - since, 0)
        scores = self._D[begin % self._length, np.arange(len(tempi.tau))] + self._heard(begin)
        scores = scores + tempi.usual * since / tempi.tau
        scores = np.where((since < tempi.tau) & (since <= self.frames), scores, -np.inf)
        k, i = np.unravel_index(scores.argmax(), scores.shape)
        return float(scores[k, i]), int(begin[k, 0]), int(i)

    def beats(self) -> TrackedBeats:
        """The beats of the last 20 s, with how sure they are; what comes later may change them."""
        frames, gains = self._back()
        if not frames:
            return TrackedBeats(np.zeros(0), np.zeros(0))
        f = np.arange(max(0, self.frames - self._kept), self.frames)
        a, first = self._a[f % self._kept], f[0] if len(f) else 0
        at = np.minimum(centres(a, np.array(frames) - first) + whole.EARLY, len(a) - 1)
        gain = uniform_filter1d(np.array(gains), min(8, len(gains)), mode="nearest")
        sure = 1 / (1 + np.exp(-(gain - whole.SURE) / whole.SURE))
        return TrackedBeats((first + at) / BEAT_FPS, sure)

    @property
    def has_beat(self) -> bool:
        """Does the music have a beat now, as far as one can tell?"""
        return self._under_way()[0] + EAGER >= self._R

    def _back(self) -> tuple[list[int], list[float]]:
        """Frames of the beats within the kept past, and how much better than no beat each is."""
        frames: list[int] = []
        gains: list[float] = []
        oldest = max(0, self.frames - self._kept + 1)
        score, f, i = self._under_way()
        end = self.frames
        if self._R > score + EAGER:
            f, i, end = self._before_silence(self.frames, oldest)
        while f >= oldest:
            heard = end < self.frames or end - f >= self._tempi.on_beat[i]
            if heard and (not frames or f != frames[-1]):
                frames.append(f)
                gains.append(self._gain(f, i, end))
            j = int(self._before[f % self._kept, i])
            if j < 0:
                f, i, end = self._before_silence(f, oldest)
                if f >= oldest:  # the interval before a silence ends on a beat
                    frames.append(end)
                    gains.append(self._gain(f, i, end))
            else:
                f, i, end = f - int(self._tempi.tau[j]), j, f
        return frames[::-1], gains[::-1]

    def _before_silence(self, f: int, oldest: int) -> tuple[int, int, int]:
        """First frame, tempo and end of the last interval before a stretch without a beat."""
        for end in range(f, oldest - 1, -1):
            i = int(self._stopped[end % self._kept])
            if i >= 0:
                return end - int(self._tempi.tau[i]), i, end
        return -1, 0, -1

    def _gain(self, f: int, i: int, end: int) -> float:
        """By how much an interval explains a frame better than no beat, (mean over its frames)."""
        kept, middle = self._kept, min(f + int(self._tempi.on_beat[i]), end)
        on = self._on[middle % kept] - self._on[f % kept]
        off = self._off[end % kept] - self._off[middle % kept]
        none = self._none[end % kept] - self._none[f % kept]
        share = (end - f) / self._tempi.tau[i]
        return float(on + off + share * self._tempi.usual[i] - none) / max(end - f, 1)
