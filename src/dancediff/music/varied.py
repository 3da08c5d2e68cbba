r"""`synth_varied_song`: songs with what real songs have, their beats and sections known.

Read first: `dancediff.music.song_plan`.

Intros, breaks and endings without a beat, 3/4 and 6/8, swing, rubato, tempo changes, half and
double time, drums alone, quiet verses, drops, fades. `dancediff.music.song_plan` draws what
happens; here it is played.

Symbols (axes: n samples · k beats)
    mix    the sound of one section or song             (n,)
    grid   its beats and where it stops, in seconds     (k + 1,)
"""

from collections.abc import Callable

import numpy as np

from dancediff.music import slow_sounds
from dancediff.music.band import Band, add
from dancediff.music.groove import write_groove
from dancediff.music.instruments import RATE
from dancediff.music.mastering import colour
from dancediff.music.song import Music
from dancediff.music.song_plan import PlannedSection, SongPlan, draw_plan
from dancediff.music.synth import SongTruth

_TAIL = 2.0  # seconds that a section sounds on into the next one
_KIT = ("kick", "snare", "hat")
_LOUD = 0.12  # RMS of a section at 0 dB


def synth_varied_song(seed: int, *, seconds: float = 30.0, tempo: float | None = None):
    """Render a song in which about everything can happen; the same seed gives the same samples.

    Where nobody could tap along, the truth has no beats. ``tempo`` is that of the first beats.

    Returns: `Music`, `SongTruth`.
    Raises: ValueError when seconds is under 1 or the tempo lies outside 60..200 BPM.

    >>> song, truth = synth_varied_song(4, seconds=8.0, tempo=120)
    >>> round(song.duration, 3), truth.meter, truth.sections[0][2]
    (8.0, 4, 'intro')
    """
    plan = draw_plan(seed, seconds=seconds, tempo=tempo)
    sections = [(part.start, part.stop, part.label) for part in plan.sections]
    truth = SongTruth(plan.tempo, plan.beats, plan.downbeats, sections, int(seed), plan.meter)
    return Music(play_plan(plan), RATE, f"varied-{seed}"), truth


def play_plan(plan: SongPlan) -> np.ndarray:
    """The sound of a plan, mono, (n,) float32 in [-1, 1]."""
    rng = np.random.default_rng([plan.seed, 3])
    players = _Players(plan, rng)
    mix = np.zeros(round((plan.seconds + _TAIL) * RATE))
    for part in plan.sections:
        sound = players.beaten(part) if len(part.beats) else players.beatless(part)
        add(mix, _levelled(sound, part), part.start, 1.0)
    mix = colour(mix[: round(plan.seconds * RATE)], rng)
    mix *= _fades(len(mix), plan)
    mix = np.tanh(plan.drive * mix) + rng.normal(size=len(mix)) * 10 ** rng.uniform(-5, -3.2)
    return (mix / np.abs(mix).max() * rng.uniform(0.3, 0.95)).astype(np.float32)


def _levelled(sound: np.ndarray, part: PlannedSection) -> np.ndarray:
    """A section's sound at its planned level."""
    inside = sound[: max(1, round((part.stop - part.start) * RATE))]
    ramp = np.interp(np.arange(len(sound)), [0, len(inside)], part.level)
    rms = float(np.sqrt(np.mean(inside**2))) + 1e-9
    return sound * (_LOUD / rms) * 10 ** (ramp / 20)


def _fades(n: int, plan: SongPlan) -> np.ndarray:
    """Factor of every sample: up from, and down to, 36 dB below."""
    sec = np.arange(n) / RATE
    dB = np.zeros(n)
    if plan.fade_in:
        dB += 36 * (np.minimum(sec / plan.fade_in, 1) - 1)
    if plan.fade_out:
        dB += 36 * (np.minimum((plan.seconds - sec) / plan.fade_out, 1) - 1)
    return 10 ** (dB / 20)


class _Players:
    """A band, with a pad, a piano and keys beside it, that plays sections of a plan."""

    def __init__(self, plan: SongPlan, rng: np.random.Generator):
        self.plan, self.rng = plan, rng
        self.band = Band(rng, 60 / plan.tempo)
        self.band.voices |= {
            "pad": slow_sounds.pad(rng),
            "piano": slow_sounds.piano(rng),
            "keys": slow_sounds.piano(rng),
        }
        self.band.level |= {"pad": 0.12, "piano": 0.5, "keys": 0.3}
        self.written: dict[str, dict] = {}  # by label: a chorus comes back as it was

    def beaten(self, part: PlannedSection) -> np.ndarray:
        """The sound of a section with a beat."""
        label = "chorus" if part.label == "drop" else part.label
        key = f"{label} {part.feel}"
        if key not in self.written:
            self.written[key] = write_groove(self.plan, label, part.feel, self.rng)
        groove = self.written[key]
        mix = np.zeros(round((part.stop - part.start + _TAIL) * RATE))
        grid = np.append(part.beats, part.stop) - part.start

        def when(beat: float) -> float:
            whole, rest = divmod(beat, 1)
            half = 0.5 + self.plan.swing
            swung = np.interp(rest, [0, 0.5, 1], [0, half, 1])
            return float(np.interp(whole + swung, np.arange(len(grid)), grid))

        beat = float(np.median(np.diff(grid)))
        self._drums(mix, part, groove, when)
        self._tones(mix, part, groove, when, beat)
        if "sweep" in part.players:
            add(mix, slow_sounds.sweep(self.rng, part.stop - part.start), 0.0, 0.3)
        return mix

    def _drums(self, mix, part: PlannedSection, groove: dict, when: Callable) -> None:
        steps, division = self.plan.meter * self.plan.division, self.plan.division
        drums = [name for name in _KIT if name in part.players or "drums" in part.players]
        if "shaker" in part.players:
            drums.append("shaker")
        for k in range(len(part.beats) * division):
            for name in drums:
                if (hit := groove[name][k % steps]) > 0:
                    sound = self.band.drums[name]
                    add(mix, sound, when(k / division), self.band.level[name] * hit)

    def _tones(self, mix, part: PlannedSection, groove: dict, when: Callable, beat: float) -> None:
        band, meter, division = self.band, self.plan.meter, self.plan.division
        for k in range(len(part.beats)):
            bar, place = divmod(k, meter)
            root = groove["chords"][bar % 4]
            stays = min(meter, len(part.beats) - k) * beat
            for player, octave in (("chord", 0), ("pad", 0)):
                if player in part.players and place == 0:
                    self._chord(mix, player, root, octave, when(k), 0.97 * stays)
            for player in ("keys", "piano"):
                if player in part.players:
                    self._chord(mix, player, root, 0, when(k), 1.2 * beat)
                    if place == 0:
                        band.note(mix, player, root, -2, when(k), 2 * beat)
            for step in range(division):
                s, at = place * division + step, when(k + step / division)
                if "bass" in part.players and groove["bass"][s]:
                    band.note(mix, "bass", root, -2, at, 1.8 * beat / division)
                if "lead" in part.players and groove["lead"][s] >= 0:
                    degree = root + int(groove["lead"][s])
                    band.note(mix, "lead", degree, 1, at, 1.9 * beat / division)

    def _chord(self, mix, player: str, root: int, octave: int, at: float, seconds: float) -> None:
        for third in (0, 2, 4):
            self.band.note(mix, player, root + third, octave, at, seconds)

    def beatless(self, part: PlannedSection) -> np.ndarray:
        """The sound of a section to which nobody could tap."""
        length = part.stop - part.start
        mix, rng = np.zeros(round((length + _TAIL) * RATE)), self.rng
        if "pad" in part.players:
            at = 0.0
            while at < length:
                stays = min(float(rng.uniform(3.5, 6)), max(length - at, 1.0)) + 1.0
                self._chord(mix, "pad", int(rng.integers(0, 6)), 0, at, stays)
                at += stays - 1.5  # one chord swells while the other dies away
        if "sweep" in part.players:
            add(mix, slow_sounds.sweep(rng, length), 0.0, 0.2)
        if "free piano" in part.players:
            self._free(mix, length, chance=0.0)
        if "arpeggio" in part.players:
            self._free(mix, length, chance=0.75)
        return mix

    def _free(self, mix, length: float, chance: float) -> None:
        """Notes at times that no tempo explains; after each, with ``chance``, a quick one."""
        rng, at, degree = self.rng, float(self.rng.uniform(0, 1)), 0
        while at < length:
            degree = int(np.clip(degree + rng.integers(-3, 4), -5, 9))
            for _ in range(1 + int(rng.random() < 0.3)):
                self.band.note(mix, "piano", degree + int(rng.integers(0, 5)), 0, at, 2.0)
            quick = rng.random() < chance
            low, high = (0.12, 0.4) if quick else (0.7, 2.4)
            at += float(np.exp(rng.uniform(np.log(low), np.log(high))))
