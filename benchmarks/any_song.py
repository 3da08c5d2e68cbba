r"""Can a model dance to any song? One table of bars: docs/results/any_song.json.

    python benchmarks/any_song.py tcdiffpp --data ../shared/data --label before
    python benchmarks/any_song.py choreographer --data ../shared/data
    python benchmarks/any_song.py runs/any/model --songs UNHEARD_SONGS --label after
    python benchmarks/any_song.py tcdiffpp --energy 1.25 --label "tcdiffpp, energy=1.25"

Three dancers, every seed, and one run of five dancers dance 40 s to `hard_songs`; and to the 40 s
of ten songs whose loudness changes most. A model that takes a genre is asked for each of them, too.
Sampling is the model's default. Training must not have heard the songs: name a folder of others
with --songs where it has heard those in --data. What was danced is kept in --out, under the model's
name and the digest of its weights, and not danced again. The model "choreographer" dances himself.

Symbols (axes: n dancers · f frames · w windows)
    joints   positions, metres, y up                                     (n, f, 24, 3)
    speed    mean speed of all joints and dancers, metres a second        (w,)
    level    A-weighted RMS of the song in windows of 2 s                 (w,)
"""

import json
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from hashlib import sha256
from pathlib import Path

import joblib
import librosa
import numpy as np
import torch
import tyro
from dance_bars import NEAR, hits, nearest_pair
from genre_judge import choreographed_solos, trained_judge, verdict
from hard_songs import SECONDS, HardSong, hard_songs, liveliest
from kept_dances import digest_of
from result_table import write_table
from tqdm.auto import tqdm

from dancediff.bench.in_processes import in_processes
from dancediff.bench.scores import loaded
from dancediff.data.choreographer import GENRES, choreograph
from dancediff.metrics.bootstrap import bootstrap_interval
from dancediff.metrics.rhythm import beat_alignment
from dancediff.motion.contact import feet_low, foot_speed
from dancediff.motion.motion import Motion
from dancediff.music.energy import energy_curve
from dancediff.music.features import SAMPLE_RATE
from dancediff.music.song import Music
from dancediff.music.sound_on_disk import SOUND_SUFFIXES

FPS, SHORT, LONG = 30, 2, 5  # frames a second; seconds of a window for loudness, and for speed
SLOWEST, FASTEST = 0.15, 0.9  # metres a second, mean of all joints
STILL, STEP = 0.015, 0.12  # metres a frame: a foot that stands, a root
MOST = 10  # songs for rhythm and loudness
CHOREOGRAPHER = "choreographer"


def loudness(music: Music) -> np.ndarray:
    """A-weighted RMS in every whole window of 2 s."""
    size, hop = 2048, SAMPLE_RATE // FPS
    power = np.abs(librosa.stft(music.mono(), n_fft=size, hop_length=hop)) ** 2
    hertz = librosa.fft_frequencies(sr=SAMPLE_RATE, n_fft=size)[1:]  # 0 Hz has no weight
    frames = (librosa.db_to_power(librosa.A_weighting(hertz))[:, None] * power[1:]).sum(0)
    return np.sqrt(in_windows(frames, SHORT))


def in_windows(curve: np.ndarray, seconds: int) -> np.ndarray:
    """Means over whole windows of a curve at 30 a second.

    >>> in_windows(np.arange(65.0), 1).tolist()
    [14.5, 44.5]
    """
    size = seconds * FPS
    return curve[: len(curve) // size * size].reshape(-1, size).mean(1)


def joint_speed(joints: torch.Tensor) -> np.ndarray:
    """Mean over joints and dancers, metres a second; (n, f, j, 3) -> (f - 1,)."""
    return joints.diff(dim=1).norm(dim=-1).mean((0, 2)).numpy() * FPS


def correlation(speed: np.ndarray, level: np.ndarray) -> float:
    """Pearson's; 0 where one of the two does not change.

    >>> round(correlation(np.array([1.0, 2, 3]), np.array([0.1, 0.2, 0.3])), 6)
    1.0
    """
    k = min(len(speed), len(level))
    a, b = speed[:k] - speed[:k].mean(), level[:k] - level[:k].mean()
    size = np.linalg.norm(a) * np.linalg.norm(b)
    return float(a @ b / size) if size > 1e-12 else 0.0


@dataclass(frozen=True)
class Moves:
    """What the bars ask of one dance to a hard song; shares in 0..1, the last nan without beats."""

    slowest: float  # metres a second, of windows of 5 s
    fastest: float
    in_range: float  # share of those windows
    feet_still: float  # share of frames of low feet
    step: float  # metres, the largest of a root in a frame
    apart: float  # share of frames with nobody nearer than 30 cm
    beats_hit: float


def moves(dance: Motion, beats: np.ndarray) -> Moves:
    """Measure one dance; beats in seconds, of the stretch where the song has any."""
    joints = dance.joints()
    speed = in_windows(joint_speed(joints), LONG)
    slow = foot_speed(joints) < STILL
    frames = np.round(beats * FPS)
    frames = frames[frames < dance.num_frames - 2]
    return Moves(
        slowest=float(speed.min()),
        fastest=float(speed.max()),
        in_range=float(((speed >= SLOWEST) & (speed <= FASTEST)).mean()),
        feet_still=slow[feet_low(joints)].float().mean().item(),
        step=dance.root.diff(dim=1).norm(dim=-1).max().item(),
        apart=(nearest_pair(dance.root) >= NEAR).float().mean().item(),
        beats_hit=hits(dance, frames) / 100 if len(frames) else np.nan,
    )


@dataclass(frozen=True)
class Listening:
    """How a dance answers its song: MMC, and the speed's correlation with loudness."""

    own: float
    shifted: float  # MMC with beats a quarter, a half and three quarters of a beat later
    follows: float
    follows_decibels: float


def listening(dance: Motion, beats: np.ndarray, level: np.ndarray) -> Listening:
    """Measure one dance; beats (k,) in seconds, level (w,) of `loudness`."""
    joints, period = dance.joints(), np.median(np.diff(beats))
    mmc = [
        beat_alignment(joints, beats + part * period, direction="motion")
        for part in (0, 0.25, 0.5, 0.75)
    ]
    speed = in_windows(joint_speed(joints), SHORT)
    decibels = librosa.amplitude_to_db(level, ref=np.max, top_db=40)
    return Listening(
        own=mmc[0],
        shifted=float(np.mean(mmc[1:])),
        follows=correlation(speed, level),
        follows_decibels=correlation(speed, decibels),
    )


@dataclass(frozen=True)
class Job:
    """A dance that is wanted."""

    song: HardSong
    dancers: int
    seed: int
    genre: str | None = None
    energy: float | None = None  # times the song's own

    @property
    def name(self) -> str:
        """Of its file."""
        parts = [self.song.name.replace(" ", "_").replace(",", ""), self.dancers, self.seed]
        return "-".join(map(str, [*parts, *([self.genre] if self.genre else [])]))


def danced(model: str, job: Job, path: Path) -> None:
    """Dance, and write the dance."""
    # every song has noise of its own, which decides more of a dance than the song does
    noise = int.from_bytes(sha256(f"{job.song.name} {job.seed}".encode()).digest()[:4])
    options: dict = {"dancers": job.dancers, "seconds": SECONDS, "seed": noise}
    options |= {"genre": job.genre} if job.genre else {}
    if model == CHOREOGRAPHER:
        energy = energy_curve(job.song.music.features())[: round(SECONDS * FPS)]
        dance, _ = choreograph(job.song.beats, energy=energy, **options)
    else:
        options |= {} if job.energy is None else {"energy": job.energy}
        dance = loaded(model).generate(job.song.music, **options)
    dance.save(path)


@dataclass
class Bar:
    """A line of the table: what was measured, with an interval where there is one."""

    text: str
    value: float
    holds: bool | None = None  # None: no bar, only to compare
    interval: tuple[float, float] | None = None

    def cell(self) -> str:
        """For the table.

        >>> Bar("", 0.91234, True, (0.9, 0.92)).cell(), Bar("", 1.5).cell()
        ('0.912 [0.900, 0.920], yes', '1.500')
        """
        words = f"{self.value:.3f}"
        words += "" if self.interval is None else " [{:.3f}, {:.3f}]".format(*self.interval)
        return words + {True: ", yes", False: ", NO", None: ""}[self.holds]


def mean_bar(
    text: str,
    songs: list[list],
    of: Callable[[list], float],
    *,
    least: float | None = None,
    most: float | None = None,
) -> Bar:
    """A number of all dances; the interval draws songs, each with all its seeds.

    ``songs`` holds, song by song, what was measured of its dances, of which ``of`` makes a number.
    """

    def number(chosen: list[list]) -> float:
        return of([one for song in chosen for one in song])

    value = number(songs)
    holds = None
    if least is not None or most is not None:
        holds = bool(value >= (-np.inf if least is None else least))
        holds = holds and bool(value <= (np.inf if most is None else most))
    interval = bootstrap_interval(number, songs) if len(songs) > 1 else None
    return Bar(text, value, holds, interval)


@dataclass
class AnySong:
    """Dance, measure, print the bars, and write them beside those of other models."""

    model: tyro.conf.Positional[str]
    data: Path = field(
        default_factory=lambda: Path(os.environ.get("DANCEDIFF_DATA", "../shared/data"))
    )
    songs: Path | None = None  # of the ten; default: music in ``data``
    seeds: tuple[int, ...] = (0, 1, 2, 3, 4)
    each: int = 5  # dances for every genre
    judge_seeds: int = 4  # trios of the choreographer a genre that the judge is trained on
    label: str | None = None  # of the column; default: the model's name
    energy: float | None = None  # times the song's own; default: the model's preset
    workers: int = 2
    out: Path = Path("runs/any_song")
    results: Path = Path("docs/results")

    def run(self) -> None:
        """Everything; both tables are written when all dances are there."""
        name = Path(self.model).name
        energy = "" if self.energy is None else f"energy{self.energy}"
        parts = (name, "" if name == CHOREOGRAPHER else digest_of(self.model), energy)
        self.folder = self.out / "-".join(filter(None, parts))
        self.folder.mkdir(parents=True, exist_ok=True)
        job = partial(Job, energy=self.energy)
        hard = [job(song, 3, seed) for song in self.hard for seed in self.seeds]
        five = [job(song, 5, self.seeds[0]) for song in self.hard]
        ten = [job(song, 3, seed) for song in self.ten for seed in self.seeds]
        asked = [replace(one, energy=self.energy) for one in self.genre_jobs()]
        self.dance([*hard, *five, *ten, *asked])
        bars = [*self.hard_bars(hard, five), *self.listening_bars(ten)]
        bars += [*self.genre_bars(asked), self.speed_bar()]
        for bar in bars:
            print(f"| {bar.text} | {bar.cell()} |")
        self.write(bars)
        if self.energy is None:
            self.write_places(hard, five)

    @cached_property
    def hard(self) -> list[HardSong]:
        """Songs with hard places."""
        return hard_songs(self.data)

    @cached_property
    def ten(self) -> list[HardSong]:
        """The 40 s of each song whose loudness changes most."""
        found = []
        for path in sorted(p for p in (self.songs or self.data / "music").iterdir()):
            if path.suffix.lower() not in SOUND_SUFFIXES:
                continue
            whole = Music.load(path)
            if whole.duration < SECONDS + LONG:
                continue
            at = liveliest(whole, SECONDS, loudness)
            part = whole.slice(at, at + SECONDS)
            song = HardSong(f"{path.stem} {at:g}", "", "recorded", part, part.beats())
            found += [song] if len(song.beats) > 1 else []
        return found[:MOST]

    def genre_jobs(self) -> list[Job]:
        """Every genre asked for, to songs in turn; none where the model takes no genre."""
        names: tuple[str, ...] = GENRES
        if self.model != CHOREOGRAPHER:
            ready = loaded(self.model)
            if "genre" not in ready.request.names():
                return []
            known = getattr(ready.config, "genres", GENRES)
            names = tuple(genre for genre in GENRES if genre in known)
        return [
            Job(self.ten[(k + i) % len(self.ten)], 3, 100 + k, genre)
            for i, genre in enumerate(names)
            for k in range(self.each)
        ]

    def path(self, job: Job) -> Path:
        """Where a dance is kept."""
        return self.folder / f"{job.name}.npz"

    def dance(self, jobs: list[Job]) -> None:
        """Dance what is not there yet."""
        todo = [job for job in jobs if not self.path(job).exists()]
        for song in {id(job.song): job.song for job in todo}.values():
            song.music.features()  # once, not in every process
        calls = (joblib.delayed(danced)(self.model, job, self.path(job)) for job in todo)
        in_processes(calls, self.workers)

    def moves_of(self, jobs: list[Job]) -> list[list[Moves]]:
        """Measured, song by song."""
        songs: dict[str, list[Moves]] = {}
        for job in jobs:
            dance = Motion.load(self.path(job))
            songs.setdefault(job.song.name, []).append(moves(dance, job.song.beats))
        return list(songs.values())

    def hard_bars(self, hard: list[Job], five: list[Job]) -> list[Bar]:
        """Bars that hold with three and with five dancers."""
        songs = [a + b for a, b in zip(*map(self.moves_of, (hard, five)), strict=True)]
        every = [one for song in songs for one in song]

        def mean(name: str) -> Callable[[list], float]:
            return lambda some: float(np.nanmean([getattr(one, name) for one in some]))

        slow, fast = min(m.slowest for m in every), max(m.fastest for m in every)
        step = max(m.step for m in every)
        with_beats = [song for song in songs if np.isfinite(song[0].beats_hit)]
        return [
            Bar("slowest 5 s, m/s: at least 0.15", slow, slow >= SLOWEST),
            Bar("fastest 5 s, m/s: at most 0.9", fast, fast <= FASTEST),
            mean_bar("share of such windows in that range", songs, mean("in_range")),
            mean_bar("low feet still: at least 0.9", songs, mean("feet_still"), least=0.9),
            Bar("largest root step, m: at most 0.12", step, step <= STEP),
            mean_bar("nobody nearer than 30 cm: at least 0.99", songs, mean("apart"), least=0.99),
            mean_bar("beats hit: at least 0.85", with_beats, mean("beats_hit"), least=0.85),
        ]

    def listening_bars(self, jobs: list[Job]) -> list[Bar]:
        """Rhythm and loudness, on the ten songs."""
        found: dict[str, list[Listening]] = {}
        levels = {song.name: loudness(song.music) for song in self.ten}
        for job in jobs:
            dance = Motion.load(self.path(job))
            heard = listening(dance, job.song.beats, levels[job.song.name])
            found.setdefault(job.song.name, []).append(heard)
        songs = list(found.values())

        def ratio(some: list[Listening]) -> float:
            return float(np.mean([m.own for m in some]) / np.mean([m.shifted for m in some]))

        return [
            mean_bar(
                f"MMC, own beats / shifted, {len(songs)} songs: at least 1.6",
                songs,
                ratio,
                least=1.6,
            ),
            mean_bar("MMC", songs, lambda some: float(np.mean([m.own for m in some]))),
            mean_bar(
                "speed and loudness correlate: at least 0.5",
                songs,
                lambda some: float(np.mean([m.follows for m in some])),
                least=0.5,
            ),
            mean_bar(
                "the same, loudness in dB",
                songs,
                lambda some: float(np.mean([m.follows_decibels for m in some])),
            ),
        ]

    def genre_bars(self, jobs: list[Job]) -> list[Bar]:
        """How often the judge finds the genre that was asked for: of all, of the worst genre."""
        if not jobs:
            return []
        solos = choreographed_solos(range(900_000, 900_000 + self.judge_seeds))
        total = 3 * self.judge_seeds * len(GENRES)
        draw = torch.Generator().manual_seed(0)
        judge = trained_judge(tqdm(solos, total=total, desc="judge"), draw)
        right: dict[str, list[list[bool]]] = {}
        for job in tqdm(jobs, desc="judging"):
            found = verdict(judge, *Motion.load(self.path(job)).features("lodge"))
            right.setdefault(str(job.genre), []).append([found == job.genre])
        for genre, answers in right.items():
            print(f"|  {genre} | {sum(a for one in answers for a in one)} of {len(answers)} |")
        everyone = [answer for answers in right.values() for answer in answers]
        worst = min(float(np.mean(answers)) for answers in right.values())
        return [
            mean_bar("genre recognised: at least 0.7", everyone, np.mean, least=0.7),
            Bar("in the worst genre: at least 0.4", worst, worst >= 0.4),
        ]

    def speed_bar(self) -> Bar:
        """Seconds for the features and beats of a minute of music, warm, best of three."""
        song = Music.load(sorted((self.data / "music").glob("EsoXLB-CPU.ogg"))[0]).slice(30, 90)
        spent = []
        for _ in range(3):
            fresh = Music(song.audio, song.rate)
            began = time.perf_counter()
            fresh.beats()
            spent.append(time.perf_counter() - began)
        return Bar("features and beats of a minute, s: at most 0.3", min(spent), min(spent) <= 0.3)

    def write(self, bars: list[Bar]) -> None:
        """Put this model's column beside those that are there."""
        path, label = self.results / "any_song.json", self.label or Path(self.model).name
        old = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
        columns = {name: {} for name in old.get("columns", ["bar"])[1:]} | {label: {}}
        for row in old.get("rows", []):
            for name, value in zip(old["columns"][1:], row[1:], strict=True):
                columns[name][row[0]] = value
        columns[label] = {bar.text: bar.cell() for bar in bars}
        names = list(dict.fromkeys(text for cells in columns.values() for text in cells))
        table = {
            "about": "Dances of 40 s, with the model's preset: three dancers with every seed and "
            "five with one, to songs with hard places; rhythm and loudness: ten songs, three "
            "dancers.",
            "data": "recorded and synthetic songs, by row of the next table; the choreographer's "
            "dances are synthetic",
            "seed": ", ".join(map(str, self.seeds)),
            "intervals": "95 % bootstrap intervals over songs, each with all its seeds",
            "command": "python benchmarks/any_song.py MODEL",
            "columns": ["bar", *columns],
            "rows": [[name, *(c.get(name) for c in columns.values())] for name in names],
        }
        write_table(path, table)

    def write_places(self, hard: list[Job], five: list[Job]) -> None:
        """A row for each hard song: three dancers, the mean of the seeds; the extremes of all."""
        rows = []
        groups = [*zip(self.hard, self.moves_of(hard), strict=True)]
        everyone = [one for song in self.moves_of(five) for one in song]
        for song, found in groups:
            rows.append([song.name, song.place, song.kind, *cells_of(found)])
        rows.append(["all, five dancers", "", "", *cells_of(everyone)])
        table = {
            "about": f"Dances of {self.label or Path(self.model).name} to songs with hard places: "
            "three dancers, all seeds together.",
            "data": "by row",
            "seed": ", ".join(map(str, self.seeds)),
            "command": "python benchmarks/any_song.py MODEL",
            "columns": ["song", "hard place", "data", "slowest 5 s, m/s", "fastest", "low feet "
                        "still", "largest root step, m", "nobody under 30 cm", "beats hit"],
            "rows": rows,
        }  # fmt: skip
        write_table(self.results / "any_song_places.json", table)


def cells_of(found: list[Moves]) -> list:
    """Extremes or means of some dances; None for beats where no song has any.

    >>> cells_of([Moves(0.3, 0.6, 1.0, 0.95, 0.05, 1.0, float("nan"))])
    [0.3, 0.6, 0.95, 0.05, 1.0, None]
    """
    hit = [one.beats_hit for one in found if np.isfinite(one.beats_hit)]
    numbers = [
        min(one.slowest for one in found),
        max(one.fastest for one in found),
        np.mean([one.feet_still for one in found]),
        max(one.step for one in found),
        np.mean([one.apart for one in found]),
        *([np.mean(hit)] if hit else []),
    ]
    return [round(float(number), 3) for number in numbers] + [None] * (not hit)


if __name__ == "__main__":
    tyro.cli(AnySong).run()
