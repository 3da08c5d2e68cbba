r"""Beats of a song, with how sure they are, and no beats where the music has none.

A hidden semi-Markov model explains the onsets of a song as intervals between beats, whose length
may change a little from one to the next, and as stretches without a beat. The best explanation is
found by dynamic programming.

Read first: notebook 02 · Krebs, Böck and Widmer 2015, "An efficient state-space model for joint
tempo and meter tracking" (tempo grid, change of tempo, observation model).

Symbols (axes: f frames at 60 a second · k beats · i j tempi)
    a      activation: how strong the onset of a frame is                (f,) within 0..1
    tau    frames between two beats, one value a tempo                   (i,)
    S      log-likelihood of an interval tau_i that begins at frame f    (f, i)
    D      best score of everything before f, if a beat begins tau_i     (f, i)
    R      best score of everything before f, if f has no beat           (f,)
"""

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from dancediff.music.frame_parts import parts_of, sound_of
from dancediff.music.librosa_import import import_librosa
from dancediff.music.sound_rate import SAMPLE_RATE

BEAT_FPS = 60  # frames a second; at 30 the lengths of fast beats are too coarse
SLOWEST, FASTEST, TEMPI = 55, 215, 48  # beats a minute, and how many tempi between them
CHANGE = 100.0  # how unlikely another tempo is: exp(-CHANGE * relative change)
USUAL, UNUSUAL = 105.0, 3.0  # tempo that people tap; nats a second for an octave more or less
ON_BEAT = 12  # one part in so many of an interval is on the beat
SWITCH = 1e-5  # how likely the beat sets in or stops at any frame
NO_BEAT = -0.05  # log-likelihood a frame; the higher, the more readily there is no beat
SURROUNDINGS = 4.0  # seconds around an onset that say how strong it is
SURE = 0.05  # log-likelihood a frame over having no beat that counts as half sure
AROUND = -2, 4  # frames around a beat's frame where its onset may lie
EARLY = 0.5  # frames; a spectrum sees an onset so long before its middle reaches it
LEAST = 0.003  # a beat may fall on a frame without any onset
QUIET = 0.25  # quiet parts count as if they were at least this loud, or hiss would have beats

BEAT_WINDOW = 1024  # samples of a spectrum: half of the features', to tell fast beats apart
AT_ONCE = 18000  # frames
_HOP = SAMPLE_RATE // BEAT_FPS
TOP_DB = 80.0  # what is this far under the loudest band of the song counts as silent


@dataclass(frozen=True)
class TrackedBeats:
    """Beats of a song: ``times`` in seconds (k,), and ``confidence`` of each, 0..1 (k,)."""

    times: np.ndarray
    confidence: np.ndarray


def beat_onset(y: np.ndarray, at_once: int = AT_ONCE) -> np.ndarray:
    """How much louder the mel bands become from frame to frame, at 60 frames a second.

    Shapes: y (n,) at 15,360 Hz -> (1 + n // 256,).

    It is made of ``at_once`` frames at a time, so that long songs fit into memory.

    >>> beat_onset(np.zeros(15360, dtype=np.float32)).shape
    (61,)
    """
    librosa = import_librosa()

    mel = _mel(y, at_once)
    quietest = librosa.power_to_db(mel.max()) - TOP_DB  # of the whole song, not of a part
    rises = [np.zeros(1, np.float32)]
    for start in range(0, len(mel) - 1, at_once):
        part = mel[start : start + at_once + 1]  # one more: a rise lies between two frames
        level = np.maximum(librosa.power_to_db(part, top_db=None), quietest)
        rises.append(np.maximum(np.diff(level, axis=0), 0).mean(axis=1))
    return np.concatenate(rises)


def _mel(y: np.ndarray, at_once: int) -> np.ndarray:
    """Power in 128 mel bands, (f, 128)."""
    librosa = import_librosa()

    frames = 1 + len(y) // _HOP
    mel = np.empty((frames, 128), np.float32)
    for start, stop in parts_of(frames, at_once):
        part = sound_of(y, start, stop, hop=_HOP, window=BEAT_WINDOW)
        mel[start:stop] = librosa.feature.melspectrogram(
            y=part, sr=SAMPLE_RATE, n_fft=BEAT_WINDOW, hop_length=_HOP, center=False
        ).T
    return mel


def beat_activation(onset: np.ndarray) -> np.ndarray:
    r"""How strong each onset is beside those around it: (f,) -> (f,) within 0..1.

    >>> float(beat_activation(np.zeros(100)).max())
    0.003
    """
    window = int(SURROUNDINGS * BEAT_FPS) | 1
    rise = np.maximum(onset - uniform_filter1d(onset, window), 0)
    strongest = uniform_filter1d(maximum_filter1d(rise, window), window)
    floor = QUIET * np.quantile(strongest, 0.9) + 1e-9
    return np.clip(rise / np.maximum(strongest, floor), LEAST, 0.95)


def track_beats(onset: np.ndarray) -> TrackedBeats:
    r"""The most likely beats of an onset envelope at 60 frames a second.

    $$D_{f,i} = \max\big(\max_j D_{f-\tau_j,\,j} + S_{f-\tau_j,\,j} + \log p_{j \to i},\;
    R_f + \log p_{\text{start}}\big), \qquad
    p_{j \to i} \propto e^{-100\,\lvert \tau_i / \tau_j - 1 \rvert}$$

    Within an interval the first twelfth is on the beat, with likelihood $a$, and the rest off it,
    with $(1 - a) / 11$. Frames without a beat have the mean of the two, as if the phase were
    unknown: music must be regular to have beats.

    Source: ours, after Krebs et al. (2015); their states have no "no beat".
    Shapes: onset (f,), any unit -> `TrackedBeats`.

    >>> clicks = np.zeros(1200)
    >>> clicks[600::30] = 1                                  # silence, then 120 beats a minute
    >>> beats = track_beats(clicks)
    >>> beats.times[:3].round(2).tolist(), bool(beats.confidence.min() > 0.4)
    ([10.01, 10.51, 11.01], True)
    """
    if not len(onset):
        return TrackedBeats(np.zeros(0), np.zeros(0))
    a = beat_activation(onset)
    model = _TempoModel(a)
    frames, gains = model.explain()
    if not len(frames):
        return TrackedBeats(np.zeros(0), np.zeros(0))
    # how much better than no beat, mean over the neighbours: one weak beat is no reason for doubt
    gains = uniform_filter1d(gains, min(8, len(gains)), mode="nearest")
    times = np.minimum(centres(a, frames) + EARLY, len(a) - 1) / BEAT_FPS
    return TrackedBeats(times, 1 / (1 + np.exp(-(gains - SURE) / SURE)))


def centres(a: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """Where within the part of an interval that is on the beat its onset lies, (k,) -> (k,).

    The model leaves open where in that part it is; the centre of the activation tells.

    >>> centres(np.array([0, 0, 0, 0.5, 0.5, 0, 0]), np.array([2])).round(2).tolist()
    [3.5]
    """
    at = np.clip(frames[:, None] + np.arange(*AROUND), 0, len(a) - 1)
    weight = np.maximum(a[at] - LEAST, 0) + 1e-6
    return (weight * at).sum(1) / weight.sum(1)


class Tempi:
    """Which tempi there are, how likely each is, and how one follows another.

    >>> int(Tempi().tau[0])                                   # frames: 212 beats a minute
    17
    """

    def __init__(self):
        periods = np.geomspace(60 * BEAT_FPS / FASTEST, 60 * BEAT_FPS / SLOWEST, TEMPI)
        self.tau = np.unique(periods.round().astype(int))
        change = -CHANGE * np.abs(self.tau / self.tau[:, None] - 1)
        self.change = change - np.log(np.exp(change).sum(1, keepdims=True))
        octaves = np.log2(60 * BEAT_FPS / self.tau / USUAL)
        self.usual = -UNUSUAL * octaves**2 * self.tau / BEAT_FPS
        self.on_beat = np.maximum(1, (self.tau / ON_BEAT).round().astype(int))


def log_likelihoods(a):
    """Of an activation on the beat, off the beat, and where there is no beat; each like ``a``."""
    off = (1 - a) / (ON_BEAT - 1)
    none = a / ON_BEAT + (1 - 1 / ON_BEAT) * off
    return np.log(a), np.log(off), np.log(none) + NO_BEAT


class _TempoModel(Tempi):
    """The scores of all explanations of an activation, and the best of them."""

    def __init__(self, a: np.ndarray):
        super().__init__()
        self.frames = len(a)
        self.on, self.off, self.none = (
            np.concatenate([[0], np.cumsum(score)]) for score in log_likelihoods(a)
        )

    def intervals(self, f: np.ndarray) -> np.ndarray:
        """S: log-likelihood of an interval of each tempo that begins at each frame, (f, i)."""
        begin = f[:, None]
        middle = np.minimum(begin + self.on_beat, self.frames)
        end = np.minimum(begin + self.tau, self.frames)
        return self.on[middle] - self.on[begin] + self.off[end] - self.off[middle] + self.usual

    def explain(self) -> tuple[np.ndarray, np.ndarray]:
        """Frames of the beats, and by how much each explains its frames better than no beat.

        As many frames as the shortest interval has are done at once: none of them depends on
        another.
        """
        tempi, every = len(self.tau), np.arange(len(self.tau))
        start, stop = np.log(SWITCH / tempi), np.log(SWITCH)
        # E[f, j]: best score of everything before f, if an interval tau_j ends there
        length = 2 * self.tau.max()
        E = np.full((length, tempi), -np.inf)  # a ring: longer ago than the slowest beat is done
        R, before = 0.0, np.empty((self.frames, tempi), dtype=np.uint8)  # R without `none`
        stopped = np.full(self.frames + 1, -1, dtype=np.int16)  # tempo that ended, if one did
        best, last = -np.inf, (0, 0)
        for first in range(0, self.frames, self.tau.min()):
            f = np.arange(first, min(first + self.tau.min(), self.frames))
            ended = E[f % length]  # (f, j)
            # the beat stops where an interval ends better than silence went on
            ends = ended.max(1) + stop - self.none[f]
            silence = np.maximum.accumulate(np.concatenate([[R], ends]))
            stopped[f + 1] = np.where(ends > silence[:-1], ended.argmax(1), -1)
            begins = (silence[:-1] + self.none[f] + start)[:, None]
            # an interval begins where another one ends, or after silence
            scores = ended[:, :, None] + self.change  # (f, j, i)
            j = scores.argmax(1)
            D = np.take_along_axis(scores, j[:, None], 1)[:, 0]
            before[f] = np.where(begins > D, tempi, j)
            D = np.maximum(D, begins) + self.intervals(f)
            past = np.where(f[:, None] + self.tau >= self.frames, D, -np.inf)
            if past.max() > best:  # the song ends within this interval
                k, i = np.unravel_index(past.argmax(), past.shape)
                best, last = past[k, i], (int(f[k]), int(i))
            R = silence[-1]
            E[f % length] = -np.inf
            E[(f[:, None] + self.tau) % length, every] = D
        silent = R + self.none[self.frames] > best
        at = self._before_silence(self.frames, stopped) if silent else last
        return self._back(at, before, stopped)

    def _before_silence(self, f: int, stopped: np.ndarray) -> tuple[int, int] | None:
        """The last interval, begin and tempo, before a stretch without beat that ends at f."""
        ends = np.flatnonzero(stopped[: f + 1] >= 0)
        if not len(ends):
            return None
        i = int(stopped[ends[-1]])
        return int(ends[-1] - 1 - self.tau[i]), i

    def _back(self, at, before: np.ndarray, stopped: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Follow the best explanation back from its last interval."""
        frames, gains, later = [], [], None
        while at is not None:
            f, i = at
            end = min(f + self.tau[i], self.frames)
            gain = (self.intervals(np.array([f]))[0, i] - self.none[end] + self.none[f]) / (end - f)
            if later != end and end < self.frames:  # the interval before a silence ends on a beat
                frames.append(end)
                gains.append(gain)
            frames.append(f)
            gains.append(gain)
            later, j = f, int(before[f, i])
            at = self._before_silence(f, stopped) if j == len(self.tau) else (f - self.tau[j], j)
        return np.array(frames[::-1], dtype=int), np.array(gains[::-1], dtype=float)
