r"""`SongPlan`: what happens when in a synthetic song, drawn before a note is played.

Read first: `dancediff.music.synth`, whose songs are simpler.

A plan is a list of sections. Each has a label, the times of its beats (none where nobody could tap
along), its players and its level. `synth_varied_song` plays it.

Symbols (axes: k beats)
    meter     beats a bar: 4, 3, or 2 for 6/8
    division  steps a beat: 4, or 3 for 6/8
    level     dB below the loudest section, at the start and at the end of a section
"""

from dataclasses import dataclass

import numpy as np

SHARES = {  # of songs in which something happens; each is drawn on its own
    "beatless intro": 0.22,
    "beatless break": 0.18,
    "beatless ending": 0.15,
    "three or six": 1 / 6,  # 3/4 or 6/8
    "swing": 0.2,
    "tempo jump": 0.08,  # at the border of two sections
    "tempo drift": 0.1,  # within a section
    "rubato": 0.1,  # a piano alone, whose beat wanders
    "half time": 0.12,
    "double time": 0.08,
    "drums only": 0.12,
    "very quiet part": 0.1,
    "drop": 0.2,
    "flat": 0.2,  # verses nearly as loud as the chorus
    "compressed": 0.15,
    "fade in": 0.08,
    "fade out": 0.15,
}
TEMPO = (60.0, 200.0)  # beats a minute that a song may reach
_FORM = ("verse", "chorus", "verse", "chorus", "bridge", "chorus")
_LEVELS = {  # dB below the chorus, quietest and loudest
    "intro": (-14, -6), "verse": (-12, -6), "bridge": (-10, -4), "build": (-10, -6),
    "chorus": (0, 0), "drop": (0, 2), "outro": (-14, -8),
    "beatless": (-20, -8), "very quiet": (-32, -24), "flat": (-3, -1),
}  # fmt: skip
_BEATLESS = (("pad",), ("pad", "sweep"), ("free piano",), ("pad", "free piano"), ("arpeggio",))
_PLAYERS = {  # some of which are drawn; without drums somebody else plays every beat
    "intro": (("drums",), ("drums", "bass"), ("keys",), ("drums", "chord")),
    "verse": (("drums", "bass", "chord"), ("drums", "bass", "keys"), ("keys", "bass"),
              ("drums", "bass", "chord", "lead")),
    "bridge": (("drums", "chord"), ("keys", "lead"), ("drums", "bass", "pad")),
    "chorus": (("drums", "shaker", "bass", "chord", "lead"), ("drums", "bass", "keys", "lead"),
               ("drums", "shaker", "bass", "chord", "pad", "lead")),
    "build": (("kick", "sweep"), ("kick", "sweep", "keys")),
}  # fmt: skip


@dataclass(frozen=True)
class PlannedSection:
    """A part of a song from ``start`` to ``stop`` seconds; see the module's symbols.

    beats    times in seconds; the first is the start, and a downbeat; none in a beatless part  (k,)
    players  who plays: drums, kick, shaker, bass, chord, keys, lead, pad, piano; without a beat
             pad, sweep, free piano, arpeggio
    feel     "straight", "half" or "double": where the drums put their weight
    """

    label: str
    start: float
    stop: float
    beats: np.ndarray
    players: tuple[str, ...]
    level: tuple[float, float]
    feel: str = "straight"


@dataclass(frozen=True)
class SongPlan:
    """A whole song; ``traits`` are those of `SHARES` that were drawn.

    swing     how far the second half of a beat comes too late, in beats
    fade_in   seconds in which the song becomes as loud as planned; ``fade_out`` likewise
    drive     how strongly loud sound is compressed; 1 is hardly
    """

    seed: int
    seconds: float
    tempo: float
    meter: int
    division: int
    swing: float
    sections: tuple[PlannedSection, ...]
    traits: frozenset[str]
    fade_in: float
    fade_out: float
    drive: float

    @property
    def beats(self) -> np.ndarray:
        """All beats of the song, seconds, (k,)."""
        beats = np.concatenate([np.zeros(0), *(part.beats for part in self.sections)])
        return beats[beats < self.seconds]

    @property
    def downbeats(self) -> np.ndarray:
        """The first beats of all bars, seconds."""
        each = [part.beats[:: self.meter] for part in self.sections]
        firsts = np.concatenate([np.zeros(0), *each])
        return firsts[firsts < self.seconds]


def draw_plan(seed: int, *, seconds: float = 30.0, tempo: float | None = None) -> SongPlan:
    """Draw a song; ``tempo`` is that of its first beats.

    Raises: ValueError when seconds is under 1 or the tempo lies outside 60..200 BPM.

    >>> plan = draw_plan(4, seconds=30)
    >>> [(part.label, len(part.beats)) for part in plan.sections]
    [('intro', 8), ('verse', 16), ('break', 0), ('build', 8), ('drop', 21)]
    """
    rng = np.random.default_rng([seed, 2])
    tempo = float(rng.uniform(84, 146)) if tempo is None else float(tempo)
    if not seconds >= 1:
        raise ValueError(f"seconds={seconds} must be at least 1")
    if not TEMPO[0] <= tempo <= TEMPO[1]:
        raise ValueError(f"tempo={tempo} is not in 60..200 beats a minute")
    traits = frozenset(name for name, share in SHARES.items() if rng.random() < share)
    meter, division = ((3, 4), (2, 3))[rng.integers(2)] if "three or six" in traits else (4, 4)
    return SongPlan(
        seed=int(seed),
        seconds=float(seconds),
        tempo=tempo,
        meter=meter,
        division=division,
        swing=float(rng.uniform(0.08, 0.17)) if "swing" in traits and division == 4 else 0.0,
        sections=tuple(_Planner(rng, traits, meter, tempo).sections(float(seconds))),
        traits=traits,
        fade_in=float(rng.uniform(3, 8)) if "fade in" in traits else 0.0,
        fade_out=float(rng.uniform(4, 10)) if "fade out" in traits else 0.0,
        drive=float(rng.uniform(4, 9) if "compressed" in traits else rng.uniform(0.3, 1)),
    )


class _Planner:
    """Lays sections one after the other; sections of one label are alike."""

    def __init__(self, rng: np.random.Generator, traits: frozenset[str], meter: int, tempo: float):
        self.rng, self.traits, self.meter, self.tempo = rng, traits, meter, tempo
        labels = list(_FORM)[int(rng.integers(0, 3)) :]
        if "drop" in traits:
            labels[1:1] = ["build", "drop"]
        if "beatless break" in traits:
            labels.insert(1, "break")
        self.form = labels if "beatless intro" in traits else ["intro", *labels]
        calm = [k for k, label in enumerate(self.form) if label in ("intro", "verse", "bridge")]
        # in which of the first such sections something special happens
        self.special = {name: int(rng.choice(calm[:2])) for name in sorted(SHARES)}
        self.jump = 1 + int(rng.integers(0, 2))
        self.like: dict[str, dict] = {}

    def sections(self, seconds: float) -> list[PlannedSection]:
        rng, out = self.rng, []
        at, end = float(rng.uniform(0, 54 / self.tempo)), seconds
        if "beatless intro" in self.traits:
            at = float(min(rng.uniform(5, 15), 0.45 * seconds))
            out.append(self._beatless("intro", 0.0, at))
        if "beatless ending" in self.traits:
            end -= float(min(rng.uniform(3, 8), 0.25 * seconds))
        k = 0
        while at < end - 1e-6:
            label = self.form[k] if k < len(self.form) else _FORM[k % len(_FORM)]
            if label == "break":
                bars = max(1, round(rng.uniform(3.5, 8) * self.tempo / 60 / self.meter))
                stop = min(at + bars * self.meter * 60 / self.tempo, end)
                out.append(self._beatless("break", at, stop))
            else:
                out.append(self._beaten(label, k, at, end))
            at, k = out[-1].stop, k + 1
        if end < seconds:
            out.append(self._beatless("outro", at, seconds))
        return out

    def _beatless(self, label: str, start: float, stop: float) -> PlannedSection:
        players = _BEATLESS[self.rng.integers(len(_BEATLESS))]
        quiet = "very quiet part" in self.traits and self.rng.random() < 0.5
        levels = self.rng.uniform(*_LEVELS["very quiet" if quiet else "beatless"], 2)
        levels = np.sort(levels) if label != "outro" else np.array([levels.max(), -36.0])
        return PlannedSection(label, start, stop, np.zeros(0), players, tuple(levels.tolist()))

    def _beaten(self, label: str, k: int, start: float, end: float) -> PlannedSection:
        rng = self.rng
        here = {name for name in self.traits if self.special[name] == k}
        like = self.like.setdefault(label, self._draw(label))
        players, feel, level = like["players"], like["feel"], like["level"]
        bars = int(rng.choice([2, 4, 4, 8])) if label not in ("intro", "build") else 2
        if "tempo jump" in self.traits and k == self.jump:
            self.tempo = float(np.clip(self.tempo * rng.choice([0.75, 0.85, 1.2, 1.33]), *TEMPO))
        goal = self.tempo
        if "tempo drift" in here:
            goal = float(np.clip(self.tempo * rng.choice([0.8, 0.87, 1.15, 1.25]), *TEMPO))
        gaps = 60 / np.linspace(self.tempo, goal, bars * self.meter)
        self.tempo = goal
        if "rubato" in here:
            players, feel, level = ("piano",), "straight", float(rng.uniform(-14, -8))
            gaps = np.clip(gaps * np.exp(_wander(rng, len(gaps))), 0.31, 1.3)
        elif "drums only" in here:
            players = ("drums", "shaker")
        if "very quiet part" in here:
            level = float(rng.uniform(*_LEVELS["very quiet"]))
        times = start + np.concatenate([[0], np.cumsum(gaps)])
        times = times[: 1 + int(np.searchsorted(times, end - 1e-9))]  # the last: where it stops
        rise = (level - 6, level) if label == "build" else (level, level)
        stop = float(min(times[-1], end))
        return PlannedSection(label, start, stop, times[:-1], players, rise, feel)

    def _draw(self, label: str) -> dict:
        """What all sections of a label share."""
        rng, kind = self.rng, "chorus" if label == "drop" else label
        players = _PLAYERS[kind][rng.integers(len(_PLAYERS[kind]))]
        level = float(rng.uniform(*_LEVELS[label]))
        if "flat" in self.traits and label in ("verse", "bridge", "intro"):
            level = float(rng.uniform(*_LEVELS["flat"]))
        feels = [name for name in ("half", "double") if f"{name} time" in self.traits]
        feel = str(rng.choice([*feels, "straight"])) if feels else "straight"
        return {"players": players, "level": level, "feel": feel}


def _wander(rng: np.random.Generator, k: int) -> np.ndarray:
    """Slow changes of pace and small ones from beat to beat, about 15 %, (k,)."""
    slow = np.sin(np.arange(k) * rng.uniform(0.3, 0.9) + rng.uniform(0, 6)) * rng.uniform(0.08, 0.2)
    return slow + rng.normal(size=k) * 0.05
