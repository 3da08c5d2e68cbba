"""How well beats are found: by the tracker of the music features and by other trackers.

    python benchmarks/beats.py                                   # synthetic songs
    python benchmarks/beats.py --data ../shared/data/music       # and recorded ones of known tempo
    python benchmarks/beats.py --midi FOLDER --soundfont FILE    # and MIDI tunes, rendered
    python benchmarks/beats.py --frets FOLDER                    # and songs of Frets on Fire

aubio (PyPI: aubio-ledfx, GPL) and metricon (MIT) take part if they are installed; MIDI needs mido
and tinysoundfont, which the project itself does not need. Debian has the songs: MIDI tunes in
openttd-openmsx (GPL-2), a sound font in timgm6mb-soundfont (GPL-2), songs with charts of their
beats in fretsonfire-songs-muldjord (CC BY-SA 3.0, El Senator) and fretsonfire-songs-sectoid (MIT,
Carlos Viola Iborra).

F-score: a beat is found if one lies within 70 ms. "Any level": the best of that and of F against
beats twice as fast, half as fast, and between the true ones. The first 5 s are not scored. The
tempo, of the median interval, is right within 4 %; at any level also if it is half or double.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import librosa
import numpy as np
import tyro
from result_table import write_table
from tqdm.auto import tqdm

from dancediff.axes import FPS
from dancediff.music.beat_tracking import BEAT_FPS, beat_activation, beat_onset, track_beats
from dancediff.music.song import Music
from dancediff.music.sound_rate import HOP, SAMPLE_RATE
from dancediff.music.synth import synth_song

TOLERANCE, SKIP, LONGEST = 0.07, 5.0, 150.0  # seconds
FIRST_SONG = 920_000  # no training heard it
# beats a minute, from the project files of the LMMS demo songs
TEMPI = {
    "CapDan-ReggaetonTry": 90,
    "EsoXLB-CPU": 128,
    "Impulslogik-Zen": 140,
    "TameAnderson-MakeMe": 140,
    "Settel-InnerRecreation": 148,
    "CapDan-TwilightArea-OriginalByAlf42red": 170,
}
Known = tuple[np.ndarray, np.ndarray]  # mono sound at SAMPLE_RATE, beats in seconds


def of_features(y: np.ndarray) -> np.ndarray:
    """Beats of the music features."""
    return track_beats(beat_onset(y)).times


def of_librosa_at_tempo(y: np.ndarray) -> np.ndarray:
    """Beats of librosa's tracker around the song's own tempo: what the features had before.

    They go from the first clear onset to the last.
    """
    rate = {"sr": SAMPLE_RATE, "hop_length": HOP}
    onset = librosa.onset.onset_strength(y=y, **rate)
    peaks = librosa.onset.onset_detect(onset_envelope=onset, units="time", **rate)
    if not len(peaks):
        return np.zeros(0)
    tempogram = librosa.feature.tempogram(onset_envelope=onset, win_length=8 * FPS, **rate)
    tempogram = tempogram.mean(axis=-1, keepdims=True)
    tempo = librosa.feature.tempo(tg=tempogram, **rate)[0]
    tempo = librosa.feature.tempo(tg=tempogram, start_bpm=float(tempo), **rate)[0]
    beats = librosa.beat.beat_track(
        onset_envelope=onset, bpm=float(tempo), trim=False, units="time", **rate
    )[1]
    return beats[(beats >= peaks[0]) & (beats <= peaks[-1])]


def of_librosa(y: np.ndarray) -> np.ndarray:
    """Beats of librosa's tracker as it comes."""
    return librosa.beat.beat_track(y=y, sr=SAMPLE_RATE, units="time")[1]


def of_aubio(y: np.ndarray) -> np.ndarray:
    """Beats of aubio's tracker as it comes."""
    import aubio

    tempo, hop = aubio.tempo("default", 1024, 256, SAMPLE_RATE), 256
    blocks = y[: len(y) // hop * hop].astype(np.float32).reshape(-1, hop)
    return np.array([tempo.get_last_s() for block in blocks if tempo(block)[0]])


def of_metricon(y: np.ndarray) -> np.ndarray:
    """Beats of metricon's decoder, from the activation of the features' tracker."""
    import metricon

    chances = metricon.Activations.from_activations(beat_activation(beat_onset(y)), fps=BEAT_FPS)
    return np.asarray(metricon.track_beats(chances).times)


TRACKERS = {
    "features": of_features,
    "librosa at the song's tempo": of_librosa_at_tempo,
    "librosa": of_librosa,
    "aubio": of_aubio,
    "metricon": of_metricon,
}


def f_score(found: np.ndarray, truth: np.ndarray) -> float:
    """F-score of beats after the first seconds; 0 if one of the lists is empty."""
    found, truth = found[found > SKIP], truth[truth > SKIP]
    if not len(found) or not len(truth):
        return 0.0
    gap = np.abs(found[:, None] - truth) <= TOLERANCE
    precision, recall = gap.any(1).mean(), gap.any(0).mean()
    return float(2 * precision * recall / (precision + recall)) if precision + recall else 0.0


def at_any_level(found: np.ndarray, truth: np.ndarray) -> float:
    """The best F-score at the beat, twice and half as fast, and between the beats."""
    between = (truth[1:] + truth[:-1]) / 2
    levels = (truth, np.sort(np.concatenate([truth, between])), truth[::2], truth[1::2], between)
    return max(f_score(found, level) for level in levels)


def tempo_ratio(found: np.ndarray, truth: np.ndarray) -> float:
    """The found tempo as a multiple of the true one; nan with fewer than two beats."""
    if len(found) < 2:
        return float("nan")
    return float(np.median(np.diff(truth)) / np.median(np.diff(found)))


def right_tempo(ratio: float) -> tuple[bool, bool]:
    """Whether a tempo is right, and whether it is right, half or double."""
    right = [abs(ratio / level - 1) < 0.04 for level in (1, 0.5, 2)]
    return right[0], any(right)


def synthetic(songs: int = 40) -> Iterator[Known]:
    """Songs of half a minute with a beat throughout."""
    for k in range(songs):
        song, truth = synth_song(FIRST_SONG + k, seconds=30)
        yield song.mono(), truth.beats


def chords(seed: int, seconds: float) -> np.ndarray:
    """Slow chords at uneven times over hiss: music without a beat."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * SAMPLE_RATE)) / SAMPLE_RATE
    y, at = rng.normal(size=len(t)) * 10 ** rng.uniform(-4, -2.5), 0.0
    while at < seconds:
        since = np.clip(t - at, 0, None)
        shape = np.clip(since / rng.uniform(0.3, 1.2), 0, 1) * np.exp(-since / rng.uniform(1, 3))
        for note in rng.choice([48, 52, 55, 57, 60, 64, 67], 3):
            y += 0.1 * shape * np.sin(2 * np.pi * librosa.midi_to_hz(note) * t)
        at += rng.uniform(1.0, 3.5)
    return (y / np.sqrt(np.square(y).mean())).astype(np.float32)


def with_intro(songs: int = 12) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Songs that begin with 6 to 14 s of `chords`; the third item is how long."""
    for k in range(songs):
        rng = np.random.default_rng(k)
        seconds = float(rng.uniform(6, 14))
        song, truth = synth_song(FIRST_SONG + 500 + k, seconds=20)
        y = song.mono()
        intro = chords(k, seconds) * rng.uniform(0.2, 0.8)
        yield (
            np.concatenate([intro, y / np.sqrt(np.square(y).mean())]),
            truth.beats + seconds,
            seconds,
        )


def constant_tempo(folder: Path) -> Iterator[Known]:
    """Recorded songs made in a sequencer, whose beats follow from the tempo alone."""
    for name, tempo in TEMPI.items():
        song = Music.load(folder / f"{name}.ogg")
        yield song.mono(), np.arange(0, song.duration, 60 / tempo)


def beats_of_midi(path: Path) -> np.ndarray:
    """Seconds of all quarter notes of a MIDI file, by its tempo track."""
    import mido

    file = mido.MidiFile(path)
    changes, last = [(0, 500_000)], 0  # ticks, microseconds a quarter note
    for track in file.tracks:
        now = 0
        for message in track:
            now += message.time
            if message.type == "set_tempo":
                changes.append((now, message.tempo))
        last = max(last, now)
    ticks, tempi = np.array(sorted(changes, key=lambda change: change[0])).T
    starts = np.concatenate([[0], np.cumsum(np.diff(ticks) * tempi[:-1])])
    at = np.arange(0, last + 1, file.ticks_per_beat)
    k = np.searchsorted(ticks, at, side="right") - 1
    return (starts[k] + (at - ticks[k]) * tempi[k]) / 1e6 / file.ticks_per_beat


def rendered(folder: Path, soundfont: Path) -> Iterator[Known]:
    """MIDI tunes of a folder, played by a sound font."""
    import tinysoundfont

    for path in sorted(folder.glob("*.mid")):
        synth = tinysoundfont.Synth(samplerate=SAMPLE_RATE * 2)
        synth.sfload(str(soundfont))
        tinysoundfont.Sequencer(synth).midi_load(str(path))
        beats = beats_of_midi(path)
        samples = int(min(beats[-1] + 2, LONGEST) * SAMPLE_RATE * 2)
        blocks = [
            np.frombuffer(bytes(synth.generate(512)), np.float32) for _ in range(samples // 512)
        ]
        y = np.concatenate(blocks).reshape(-1, 2)
        yield Music(y, SAMPLE_RATE * 2).mono(), beats


def charted(folder: Path) -> Iterator[Known]:
    """Songs of Frets on Fire: the band and the guitar are two files, the beats a third."""
    for path in sorted(folder.rglob("notes.mid")):
        band, guitar = (
            Music.load(path.with_name(f"{part}.ogg")).mono() for part in ("song", "guitar")
        )
        k = min(len(band), len(guitar))
        yield band[:k] + guitar[:k], beats_of_midi(path)


@dataclass
class Beats:
    """Score every tracker on every set of songs; print and write docs/results/beats.json."""

    data: Path | None = None
    midi: Path | None = None
    soundfont: Path | None = None
    frets: Path | None = None
    out: Path = Path("docs/results/beats.json")

    def sets(self) -> dict[str, Iterator[Known]]:
        """Songs by the name of their set."""
        sets = {"synthetic": synthetic()}
        if self.data:
            sets["recorded, constant tempo"] = constant_tempo(self.data)
        if self.midi and self.soundfont:
            sets["MIDI, rendered"] = rendered(self.midi, self.soundfont)
        if self.frets:
            sets["recorded, charted"] = charted(self.frets)
        return sets

    def run(self) -> None:
        """Everything, row by row."""
        trackers = {name: tracker for name, tracker in TRACKERS.items() if works(tracker)}
        rows = []
        for name, songs in self.sets().items():
            scores: dict[str, list] = {tracker: [] for tracker in trackers}
            tempi: dict[str, list] = {tracker: [] for tracker in trackers}
            for y, truth in tqdm(songs, desc=name):
                sound, beats = y[: int(LONGEST * SAMPLE_RATE)], truth[truth < LONGEST]
                for tracker, track in trackers.items():
                    found = track(sound)
                    scores[tracker].append((f_score(found, beats), at_any_level(found, beats)))
                    tempi[tracker].append(right_tempo(tempo_ratio(found, beats)))
            for what, per in (("", scores), ("tempo right, ", tempi)):
                cells = [number for each in per.values() for number in np.mean(each, 0).round(2)]
                rows.append([f"{what}{name} ({len(per['features'])} songs)", *cells])
        false = {tracker: [] for tracker in trackers}
        after = {tracker: [] for tracker in trackers}
        for y, truth, seconds in tqdm(with_intro(), desc="intros"):
            for tracker, track in trackers.items():
                found = track(y)
                false[tracker].append((found < seconds - 0.3).sum() / seconds)
                after[tracker].append(f_score(found[found > seconds - 0.3], truth))
        rows.append(
            ["F after an intro without a beat (12 songs)"]
            + [cell for each in after.values() for cell in (round(float(np.mean(each)), 2), None)]
        )
        rows.append(
            ["false beats a second in such intros"]
            + [cell for each in false.values() for cell in (round(float(np.mean(each)), 2), None)]
        )
        columns = ["songs"] + [c for name in trackers for c in (name, f"{name}, any level")]
        table = {
            "about": "F-score of beats (70 ms), means over songs; share with the right tempo.",
            "data": "synthetic where it says so, else recorded, or rendered from MIDI",
            "command": "python benchmarks/beats.py --data … --midi … --soundfont … --frets …",
            "columns": columns,
            "rows": rows,
        }
        write_table(self.out, table)
        for row in [columns, *rows]:
            print(*row, sep=" | ")


def works(tracker: Callable) -> bool:
    """Whether what a tracker needs is installed."""
    try:
        tracker(np.zeros(8 * SAMPLE_RATE, dtype=np.float32))
    except ImportError:
        return False
    return True


if __name__ == "__main__":
    tyro.cli(Beats).run()
