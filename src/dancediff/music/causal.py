r"""`CausalMusic`: the features of music that nobody knows in advance, and of its next five seconds.

Read first: notebook 02 · `dancediff.music.causal_frames` · `dancediff.music.next_beat`.

Symbols (axes: f frames at 30 a second · m = 35 features)
    M   features, raw, as `Music.features` has them                       (f, m)
"""

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.music.arriving_sound import ArrivingSound
from dancediff.music.beat_tracking import TrackedBeats
from dancediff.music.causal_frames import BACK, CausalFrames
from dancediff.music.energy import energy_curve, loudness_of
from dancediff.music.features import (
    BEATS,
    CHROMA,
    LATE,
    MFCC,
    NUM_FEATURES,
    ONSET,
    PEAKS,
)
from dancediff.music.frame_chroma import cens
from dancediff.music.librosa_import import import_librosa
from dancediff.music.next_beat import beat_line, coming_beats
from dancediff.music.sections import BAR
from dancediff.music.song import LOUDNESS, SILENT
from dancediff.music.sound_rate import HOP, SAMPLE_RATE

AHEAD = 5  # seconds that are foretold
_HELD = FPS  # frames whose mean goes on where there is no beat


class CausalMusic:
    """Music that arrives block by block; features of what was heard, and of what may come.

    ``window`` gives what `Music.features` would: the same columns in the same units. What belongs
    to a whole song is that of the song so far: its loudness, its loudest band and onset. The next
    five seconds repeat the onsets and the timbre of the last bar, and beats go on evenly; harmony,
    and all of it where there is no beat, stays at the mean of the last second. All of it is put
    right as sound arrives. Notes are not tuned to the song.

    The same samples give the same features, whatever the blocks. Memory does not grow.

    Raises: ValueError as `ArrivingSound`.

    >>> music = CausalMusic(rate=15360)
    >>> music.push(np.zeros(15360))
    >>> music.now, music.window(0, 180).shape, music.beats().tolist()
    (1.0, torch.Size([180, 35]), [])
    """

    def __init__(self, rate: int = 22050):
        self.rate = rate
        self._sound, self._frames = ArrivingSound(rate), CausalFrames()
        self._made: tuple[int, Tensor] | None = None

    def push(self, samples) -> None:
        """Hear a block, (n,) or (n, channels), of any length."""
        for frame in self._sound.push(samples):
            self._frames.hear(frame)

    @property
    def num_frames(self) -> int:
        """Frames that were heard."""
        return self._frames.heard

    @property
    def now(self) -> float:
        """Seconds that were heard."""
        return self.num_frames * HOP / SAMPLE_RATE

    @property
    def first_frame(self) -> int:
        """The first frame that is still known."""
        return self._frames.oldest

    def window(self, start: int, frames: int) -> Tensor:
        """Features of frames from ``start`` on, heard or foretold, (frames, 35), raw.

        Raises: ValueError when some of them are forgotten, or more than five seconds ahead.
        """
        return self._all()[self._part(start, frames)].clone()

    def energy(self, start: int, frames: int) -> Tensor:
        """How loud each frame is beside the loud parts so far, 0..1; see `energy_curve`."""
        power = torch.tensor(self._frames.power, dtype=torch.float64) * 10 ** (self._gain() / 10)
        return energy_curve(self._all(), loudness_of(power))[self._part(start, frames)]

    def beats(self) -> np.ndarray:
        """Seconds of the beats of the past that is kept, and of those to come in five seconds."""
        return self._tracked().times

    def beat_confidence(self) -> np.ndarray:
        """How sure each of the beats is, 0 to 1; those to come are as sure as the last ones."""
        return self._tracked().confidence

    @property
    def tempo(self) -> float:
        """Beats per minute now; nan where there is no beat."""
        return 60 / beat_line(self._frames.beats.beats().times)[1]

    def _part(self, start: int, frames: int) -> slice:
        first, last = self.first_frame, self.num_frames + AHEAD * FPS
        if frames < 1 or start < first or start + frames > last:
            raise ValueError(
                f"start={start}, frames={frames}: frames {first} to {last} are known at "
                f"{self.now:.1f} s; ask for some of them"
            )
        return slice(start - first, start - first + frames)

    def _gain(self) -> float:
        """By how many dB the sound is made louder, so that all that was heard has the same RMS."""
        power = self._frames.mean_power
        return 20 * np.log10(LOUDNESS) - 10 * np.log10(power) if power**0.5 > SILENT * 0.1 else 0.0

    def _tracked(self) -> TrackedBeats:
        """Beats that were heard, then those that go on."""
        tracker = self._frames.beats
        known = tracker.beats()
        if not tracker.has_beat:
            return known
        t, T = beat_line(known.times)
        to_come = coming_beats(known.times, t + T / 2, self.now + AHEAD)
        sure = np.full(len(to_come), known.confidence[-1] if len(known.times) else 0.0)
        return TrackedBeats(
            np.concatenate([known.times, to_come]), np.concatenate([known.confidence, sure])
        )

    def _all(self) -> Tensor:
        """M of everything that is known and foretold; made anew when more was heard."""
        if self._made is None or self._made[0] != self.num_frames:
            self._made = self.num_frames, torch.from_numpy(self._features())
        return self._made[1]

    def _features(self) -> np.ndarray:
        frames, total = self._frames, self.num_frames + AHEAD * FPS - self.first_frame
        M = np.zeros((total, NUM_FEATURES), dtype=np.float32)
        rows = np.array(frames.rows).reshape(-1, MFCC.stop)
        if not len(rows):  # nothing was heard yet: silence
            M[:, MFCC.start] = -100 * 128**0.5
            return M
        rows[:, MFCC.start] += self._gain() * 128**0.5
        onset = np.concatenate([rows[:, 0], frames.coming_onsets])
        bar = BAR * beat_line(frames.beats.beats().times)[1] * FPS
        bar = bar if frames.beats.has_beat else np.nan
        M[:, ONSET] = continued(onset[:, None], total, bar)
        # what sounds now is known two frames later: until then it is as before, not as a bar ago
        M[:, MFCC] = continued(np.pad(rows[:, MFCC], ((0, BACK), (0, 0)), mode="edge"), total, bar)
        M[:, CHROMA] = continued(cens(frames.chroma()), total, np.nan)
        M[_peaks(M[:, 0] / max(frames.loudest_onset, 1e-9)), PEAKS] = 1
        at = np.round((self.beats() + LATE) * FPS).astype(int) - self.first_frame
        M[at[(at >= 0) & (at < total)], BEATS] = 1
        return M


def continued(X: np.ndarray, frames: int, bar: float) -> np.ndarray:
    """X, then its last bar over and over, or the mean of its last second if ``bar`` is nan.

    Shapes: X (f, d), bar in frames, not always a whole number -> (frames, d).

    >>> continued(np.arange(5)[:, None], 9, 2.5)[:, 0].tolist()
    [0, 1, 2, 3, 4, 2, 4, 2, 3]
    """
    X = X[:frames]
    later = np.arange(len(X), frames)
    if np.isnan(bar):
        return np.concatenate([X, np.tile(X[-_HELD:].mean(0), (len(later), 1))])
    back = np.ceil((later - len(X) + 1) / bar) * bar
    source = np.clip(np.round(later - back), 0, len(X) - 1).astype(int)
    return np.concatenate([X, X[source]])


def _peaks(onset: np.ndarray) -> np.ndarray:
    """Frames of onsets that stand out, of an envelope whose largest value so far is 1."""
    librosa = import_librosa()

    return librosa.onset.onset_detect(
        onset_envelope=onset, normalize=False, sr=SAMPLE_RATE, hop_length=HOP
    )
