r"""Synthetic songs and the dances that the choreographer makes to them: one corpus for everybody.

Read first: `dancediff.music.song_plan` and `dancediff.data.choreographer.choreograph`.

`dancediff prepare choreograph`, training without data and ablations learn from these takes. Every
song is danced by a group of every size, perhaps several times. All of it follows from the seeds.
Genres take turns from song to song; the tempo is drawn from those that suit the genre. Songs are
simple (`synth_song`) or ``varied`` (`synth_varied_song`): with intros and breaks without a beat,
other meters, tempo changes. To these, `dancediff prepare choreograph` and training without data
dance, half of the time in any genre: a network that always sees the genre which suits the song
learns to read it from the tempo, and not to dance the one that somebody asks for.

Symbols (axes: f frames · m music features)
    M   music features of a song, raw   (f, m)
"""

import itertools
import json
import operator
from dataclasses import dataclass
from functools import lru_cache, partial
from hashlib import sha256

import numpy as np
import torch
from torch import Tensor
from tqdm.auto import tqdm

from dancediff.backends import run_jobs
from dancediff.data.cache import cached, code_digest, content_key
from dancediff.data.choreographer import GENRES, choreograph
from dancediff.data.packed import PackedTakes
from dancediff.data.prepare import prepare
from dancediff.data.take import DanceTake, Job
from dancediff.genre import TEMPOS
from dancediff.music.energy import energy_curve
from dancediff.music.synth import synth_song
from dancediff.music.varied import synth_varied_song

SIZES = (1, 2, 3, 4, 5)  # of groups
SHOWN_FROM = 4  # songs from which on making them shows its progress: each takes a second or more
SOURCE = "dancediff's choreographer and synthesiser"
LICENCE = "MIT (made by this project's own code)"
ANY_GENRE = 0.5  # share of dances to varied and recorded songs in a genre drawn from all
_LETTERS = ["", *"bcdefghij"]  # of the first dance to a song, of the second, ...


def choreograph_jobs(
    num: int,
    *,
    seconds: float = 10.0,
    seed: int = 0,
    sizes=SIZES,
    repeats: int = 1,
    share: float = 0.1,
    varied: bool = False,
) -> list[Job]:
    """Jobs for ``num`` synthetic dances: songs ``seed``, ``seed + 1``, ..., each in all ``sizes``.

    With ``repeats`` each size dances the song that many times, always differently. All dances to
    one song are in one split; ``share`` of the songs is expected in "val". Jobs of one song stand
    far apart, so that several workers do not make the same song at once.

    Raises: ValueError naming the argument.

    >>> [job.name for job in choreograph_jobs(4, sizes=(1, 3))]
    ['choreographed_000000_1', 'choreographed_000001_1',
     'choreographed_000000_3', 'choreographed_000001_3']
    """
    num, seed, sizes = operator.index(num), operator.index(seed), tuple(sizes)
    if num < 1:
        raise ValueError(f"num={num} must be at least 1")
    if seed < 0:
        raise ValueError(f"seed={seed} must not be negative")
    if not 5 <= seconds < 3600:
        raise ValueError(f"seconds={seconds} is no length; choose 5 (one window) to an hour")
    if not 0 <= share < 1:
        raise ValueError(f"share={share} is out of range; choose 0 to below 1")
    if not sizes or not set(sizes) <= set(SIZES):
        raise ValueError(f"sizes={sizes} are not all in {SIZES[0]}..{SIZES[-1]}")
    if not 1 <= operator.index(repeats) <= len(_LETTERS):
        raise ValueError(f"repeats={repeats} is not in 1..{len(_LETTERS)}")
    dances = list(itertools.product(range(repeats), sizes))  # to each song
    songs = -(-num // len(dances))
    last = num - (songs - 1) * len(dances)  # how many to the last song
    return [
        _job(song, n, again, seconds=float(seconds), share=float(share), varied=bool(varied))
        for place, (again, n) in enumerate(dances)
        for song in range(seed, seed + songs - (place >= last))
    ]


def make_choreographed(
    song_seed: int,
    n: int,
    again: int = 0,
    *,
    seconds: float,
    share: float = 0.0,
    varied: bool = False,
) -> DanceTake:
    """Dance number ``again`` of n people to one song."""
    return synthetic_song(song_seed, seconds, varied).danced_by(n, again, share)


def choreographed_takes(
    song_seed: int, *, seconds: float = 30.0, sizes=SIZES, varied: bool = False
) -> list[DanceTake]:
    """One synthetic song, danced once by a group of every size; the same takes as the jobs make.

    >>> [take.x.shape for take in choreographed_takes(0, seconds=6, sizes=(1, 3))]
    [torch.Size([1, 180, 151]), torch.Size([3, 180, 151])]
    """
    song = synthetic_song(song_seed, seconds, varied)
    return [song.danced_by(n) for n in sizes]


def choreographed_corpus(
    song_seeds,
    *,
    seconds: float = 30.0,
    sizes=SIZES,
    varied: bool = False,
    workers: int = 2,
    cache=None,
) -> list[DanceTake]:
    """A training set without a data set: `choreographed_takes` of many songs, in their order.

    ``cache`` is a folder: takes are prepared there and read from disk, and a run that was stopped
    goes on with the take it had reached.

    Raises: ValueError naming the take that could not be made.
    """
    seeds, sizes = list(song_seeds), tuple(sizes)
    if cache is None:
        make = partial(choreographed_takes, seconds=seconds, sizes=sizes, varied=varied)
        made = run_jobs(make, seeds, workers=max(1, workers))
        few = len(seeds) < SHOWN_FROM
        songs = dict(tqdm(made, "composing songs", len(seeds), leave=False, disable=few))
        return list(itertools.chain.from_iterable(songs[k] for k in range(len(seeds))))
    options: dict = {"seconds": float(seconds), "share": 0.0, "varied": bool(varied)}
    jobs = [_job(seed, n, 0, **options) for seed in seeds for n in sizes]
    if not jobs:
        return []
    summary = prepare(jobs, cache, workers=workers, progress=len(seeds) >= SHOWN_FROM)
    for name, reason in summary.skipped.items():
        raise ValueError(f"{name}: {reason}")
    takes = {take.name: take for take in PackedTakes(cache).takes()}
    return [takes[job.name] for job in jobs]


def _name(song_seed: int, n: int, again: int = 0) -> str:
    return f"choreographed_{song_seed:06d}_{n}{_LETTERS[again]}"


def _job(song_seed: int, n: int, again: int, **options) -> Job:
    return Job(
        _name(song_seed, n, again), partial(make_choreographed, song_seed, n, again, **options)
    )


@dataclass(frozen=True, eq=False)
class SyntheticSong:
    """A song's features M (f, m) and what is known of it; beats in seconds, ``meter`` a bar."""

    seed: int
    seconds: float
    genre: str
    tempo: float  # beats a minute
    M: Tensor
    beats: np.ndarray
    sections: list
    meter: int = 4
    varied: bool = False  # then its loudness is danced, too

    def danced_by(self, n: int, again: int = 0, share: float = 0.0) -> DanceTake:
        """Dance number ``again`` of n people; ``share`` of the songs is expected in "val"."""
        seed = 10 * self.seed + n + again * 10**9
        options: dict = {"sections": self.sections, "seconds": self.seconds, "meter": self.meter}
        options["genre"] = (any_genre(seed) if self.varied else None) or self.genre
        if self.varied:
            options["energy"] = energy_curve(self.M)
        dance, truth = choreograph(self.beats, dancers=n, seed=seed, **options)
        f = min(dance.num_frames, len(self.M))
        digest = sha256(f"choreographed {self.seed}".encode()).digest()
        return DanceTake(
            name=_name(self.seed, n, again),
            dance=dance.frames(0, f),
            kind="synthetic",
            music="synthetic",
            source=SOURCE,
            licence=LICENCE,
            split="val" if int.from_bytes(digest[:8]) < share * 2**64 else "train",
            group=f"synth-{self.seed}",
            M=self.M[:f],
            beats=self.beats[self.beats < f / dance.fps],
            genre=truth.genre,
            notes={"seed": seed, "tempo": self.tempo, "meter": self.meter},
        )


def any_genre(seed: int) -> str | None:
    """One of all genres in a share of dances, `ANY_GENRE`; else None: one that suits the song.

    >>> [any_genre(seed) for seed in range(4)]
    [None, 'bollywood', 'locking', 'locking']
    """
    rng = np.random.default_rng([seed, 3])
    return str(rng.choice(list(GENRES))) if rng.random() < ANY_GENRE else None


def genre_and_tempo(song_seed: int) -> tuple[str, float]:
    """What a song is for, and its tempo in beats a minute.

    >>> genre_and_tempo(0)[0] == genre_and_tempo(len(TEMPOS))[0]
    True
    """
    genre = list(TEMPOS)[song_seed % len(TEMPOS)]
    rng = np.random.default_rng([song_seed, 1])
    return genre, round(float(rng.uniform(*np.clip(TEMPOS[genre], 60, 200))), 1)


def synthetic_song(seed: int, seconds: float, varied: bool = False) -> SyntheticSong:
    """A song of a genre's tempo, from the cache if it is there."""
    genre, tempo = genre_and_tempo(seed)
    key = content_key("song", code_digest(("music",)), seed, seconds, tempo, varied)
    synth = synth_varied_song if varied else synth_song
    render = lru_cache(partial(synth, seed, seconds=seconds, tempo=tempo))  # at most once

    def facts() -> np.ndarray:
        _, truth = render()
        words = {"beats": truth.beats.tolist(), "sections": truth.sections, "meter": truth.meter}
        return np.frombuffer(json.dumps(words).encode(), dtype=np.uint8)

    known = json.loads(cached(f"{key}.truth", facts).tobytes())
    M = torch.from_numpy(cached(key, lambda: render()[0].features().numpy()))
    sections = [tuple(section) for section in known["sections"]]
    return SyntheticSong(
        seed, seconds, genre, tempo, M, np.array(known["beats"]), sections, known["meter"], varied
    )
