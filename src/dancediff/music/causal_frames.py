r"""What each frame of sound says as soon as it is heard.

Read first: `dancediff.music.features` · `dancediff.music.online_beats`.

Symbols (axes: f frames at 30 a second · b mel bands)
    row      onset 1 | MFCC 20, of the sound as loud as it came        (21,)
    levels   five levels of 12 pitch classes, before they are smoothed (12,)
"""

from collections import deque
from functools import cache

import numpy as np
import torch
from scipy import fft

from dancediff.axes import FPS
from dancediff.music.beat_tracking import BEAT_WINDOW, TOP_DB
from dancediff.music.energy import frame_power
from dancediff.music.features import MFCC, NUM_FEATURES, WINDOW
from dancediff.music.frame_chroma import REACH, SPAN, chroma_levels
from dancediff.music.librosa_import import import_librosa
from dancediff.music.online_beats import PAST, OnlineBeats
from dancediff.music.sound_rate import HOP, SAMPLE_RATE

BACK = 2  # frames that a spectrum needs after its own
KEPT = PAST * FPS  # frames that are kept
_REMEMBERED = 600 * FPS  # frames whose loudness is kept: ten minutes
_QUIETEST = 1e-10  # power


class CausalFrames:
    """Rows, pitch classes, beats and loudness of a sound that is heard frame by frame.

    Of the past, 20 s are kept, and the loudness of ten minutes.

    >>> frames = CausalFrames()
    >>> for _ in range(60):
    ...     frames.hear(np.zeros(HOP, np.float32))
    >>> frames.heard, len(frames.rows), frames.chroma().shape, frames.beats.frames
    (60, 59, (59, 12), 119)
    """

    def __init__(self):
        self.heard = 0  # frames
        self.rows: deque[np.ndarray] = deque(maxlen=KEPT)
        self.beats = OnlineBeats()
        self.power: deque[float] = deque(maxlen=_REMEMBERED)  # A-weighted
        self.loudest_onset, self._energy = 0.0, 0.0
        self._levels: deque[np.ndarray] = deque(maxlen=KEPT)
        self._sound = np.zeros(SPAN, np.float32)
        self._onset = _Onset(WINDOW), _Onset(BEAT_WINDOW)
        self._later: deque[float] = deque([0.0] * BACK)

    def hear(self, frame: np.ndarray) -> None:
        """One frame of sound, (512,) at 15,360 Hz."""
        self._sound = np.concatenate([self._sound[HOP:], frame])
        self.heard += 1
        self._energy += float(np.square(frame, dtype=np.float64).sum())
        for end in (HOP // 2, 0):  # the tracker's frames are half as long
            if self.heard > 1 or not end:  # the middle of the first one is the first sample
                self.beats.push(self._onset[1].of(self._sound[: SPAN - end])[0])
        if self.heard < BACK:
            return
        onset, level = self._onset[0].of(self._sound)
        self._later.append(onset)  # librosa's onsets stand two frames after the spectrum that rises
        self.loudest_onset = max(self.loudest_onset, onset)
        row = np.concatenate([[self._later.popleft()], fft.dct(level, norm="ortho")[:20]])
        self.rows.append(row)
        M = torch.zeros(1, NUM_FEATURES)
        M[:, MFCC] = torch.from_numpy(row[1:])
        self.power.append(float(frame_power(M)))
        if self.heard >= REACH:
            self._levels.append(self._levels_at(REACH))

    def _levels_at(self, ago: int) -> np.ndarray:
        """The pitch classes of a frame so long ago; what is not heard yet counts as silence."""
        known = self._sound[SPAN // 2 - ago * HOP :]
        return chroma_levels(np.pad(known, (0, SPAN))[:SPAN])

    @property
    def oldest(self) -> int:
        """Number of the first frame that is kept."""
        return max(0, self.heard - BACK + 1 - KEPT)

    @property
    def coming_onsets(self) -> list[float]:
        """Onsets of the two frames after the last row, which are known already."""
        return list(self._later)

    def chroma(self) -> np.ndarray:
        """Levels of the pitch classes of all kept rows, (f, 12), the last ones as yet."""
        ago = range(min(REACH - 1, self.heard), BACK - 1, -1)
        levels = [*self._levels, *(self._levels_at(frames) for frames in ago)]
        return np.array(levels[-len(self.rows) :]).reshape(-1, 12)

    @property
    def mean_power(self) -> float:
        """Mean of the squared samples of all that was heard."""
        return self._energy / (max(self.heard, 1) * HOP)


class _Onset:
    """How much louder the mel bands become from one spectrum to the next, and their level."""

    def __init__(self, window: int):
        self.window, self.loudest = window, _QUIETEST
        self.before: np.ndarray | None = None

    def of(self, sound: np.ndarray) -> tuple[float, np.ndarray]:
        """Of the spectrum at the end of a sound: onset, and level in dB (128,)."""
        basis, weight = _mel(self.window)
        spectrum = fft.rfft(sound[-self.window :] * weight)
        mel = basis @ (spectrum.real**2 + spectrum.imag**2)
        self.loudest = max(self.loudest, float(mel.max()))
        quietest = max(_QUIETEST, self.loudest * 10 ** (-TOP_DB / 10))  # the loudest so far
        level = 10 * np.log10(np.maximum(mel, quietest))
        rise = 0.0 if self.before is None else float(np.maximum(level - self.before, 0).mean())
        self.before = level
        return rise, level


@cache
def _mel(window: int) -> tuple[np.ndarray, np.ndarray]:
    """Mel bands of a power spectrum (b, 1 + window / 2), and the window itself."""
    librosa = import_librosa()

    basis = librosa.filters.mel(sr=SAMPLE_RATE, n_fft=window).astype(np.float32)
    return basis, librosa.filters.get_window("hann", window).astype(np.float32)
