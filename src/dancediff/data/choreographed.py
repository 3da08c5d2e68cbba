r"""Synthetic songs and the dances that the choreographer makes to them, as jobs for `prepare`.

Every song is danced by a group of every size, perhaps several times. All of it follows from the
seeds. Genres take turns from song to song; the tempo is drawn from those that suit the genre.

Symbols (axes: f frames · m music features)
    M   music features of a song, raw   (f, m)
"""

import itertools
import json
import operator
from functools import lru_cache, partial
from hashlib import sha256

import numpy as np
import torch
from torch import Tensor

from dancediff.data.cache import cached, code_digest, content_key
from dancediff.data.choreographer import choreograph
from dancediff.data.choreographer.genres import GENRES
from dancediff.data.corpus import SIZES
from dancediff.data.take import DanceTake, Job
from dancediff.music.synth import synth_song

SOURCE = "dancediff's choreographer and synthesiser"
LICENCE = "MIT (made by this project's own code)"
_LETTERS = ["", *"bcdefghij"]  # of the first dance to a song, of the second, ...


def choreograph_jobs(
    num: int,
    *,
    seconds: float = 10.0,
    seed: int = 0,
    sizes=SIZES,
    repeats: int = 1,
    share: float = 0.1,
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
    options = {"seconds": float(seconds), "share": float(share)}
    jobs = []
    for place, (again, n) in enumerate(dances):
        for song in range(seed, seed + songs - (place >= last)):
            name = f"choreographed_{song:06d}_{n}{_LETTERS[again]}"
            make = partial(make_choreographed, name, song, n, again, **options)
            jobs.append(Job(name, make))
    return jobs


def make_choreographed(
    name: str, song_seed: int, n: int, again: int, *, seconds: float, share: float
) -> DanceTake:
    """Dance number ``again`` of n people to one song."""
    genre, tempo = genre_and_tempo(song_seed)
    M, beats, sections = song_of(song_seed, seconds, tempo)
    seed = 10 * song_seed + n + again * 10**9
    dance, _ = choreograph(
        beats, dancers=n, seed=seed, seconds=seconds, genre=genre, sections=sections
    )
    f = min(dance.num_frames, len(M))
    digest = sha256(f"choreographed {song_seed}".encode()).digest()
    return DanceTake(
        name=name,
        motion=dance.frames(0, f),
        kind="synthetic",
        music="synthetic",
        source=SOURCE,
        licence=LICENCE,
        split="val" if int.from_bytes(digest[:8]) < share * 2**64 else "train",
        group=f"synth-{song_seed}",
        M=M[:f],
        beats=beats[beats < f / dance.fps],
        genre=genre,
        notes={"seed": seed, "tempo": tempo},
    )


def genre_and_tempo(song_seed: int) -> tuple[str, float]:
    """What a song is for, and its tempo in beats a minute.

    >>> genre_and_tempo(0)[0] == genre_and_tempo(len(GENRES))[0]
    True
    """
    genre = list(GENRES.values())[song_seed % len(GENRES)]
    low, high = np.clip(genre.tempo, 60, 200)
    return genre.name, round(float(np.random.default_rng([song_seed, 1]).uniform(low, high)), 1)


def song_of(seed: int, seconds: float, tempo: float) -> tuple[Tensor, np.ndarray, list]:
    """Features (f, m), beats (s) and sections of a synthetic song, from the cache if there."""
    key = content_key("song", code_digest(("music",)), seed, seconds, tempo)
    render = lru_cache(partial(synth_song, seed, seconds=seconds, tempo=tempo))  # at most once

    def truth() -> np.ndarray:
        _, known = render()
        text = json.dumps({"beats": known.beats.tolist(), "sections": known.sections})
        return np.frombuffer(text.encode(), dtype=np.uint8)

    known = json.loads(cached(f"{key}.truth", truth).tobytes())
    M = torch.from_numpy(cached(key, lambda: render()[0].features().numpy()))
    return M, np.array(known["beats"]), [tuple(section) for section in known["sections"]]
