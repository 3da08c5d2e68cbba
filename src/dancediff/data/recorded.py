r"""Recorded songs, danced by the choreographer: what `dancediff prepare songs` makes.

Read first: data_prep/README.md, section Songs.

Each dance takes another part of a song, of a length of one's choice, anywhere in it; the first one
takes its beginning. Features, beats and sections are those of the whole song. No sound is kept.
Half of the dances are in a genre that suits the tempo, half in any.

Symbols (axes: f frames · m music features)
    M   music features of a whole song, raw   (f, m)
"""

import itertools
import json
import operator
from contextlib import suppress
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.data.cache import cached, code_digest, content_key
from dancediff.data.choreographed import SIZES, any_genre
from dancediff.data.choreographer import choreograph
from dancediff.data.names import take_name
from dancediff.data.song_folder import SongFile, songs_in
from dancediff.data.take import DanceTake, Job
from dancediff.music.augment import augment_song
from dancediff.music.energy import energy_curve, song_loudness
from dancediff.music.features import beat_times
from dancediff.music.sections import song_sections
from dancediff.music.song import Music

SHORTEST_RECORDED = 6.0  # seconds of a song that can be danced to
BEGINNINGS = 0.25  # share of the dances that take the beginning of a song, beside the first
SHARE = 0.1  # of the songs, expected in "val"


def song_jobs(
    folder,
    *,
    dances_per_song: int = 5,
    augment: int = 0,
    seconds: float = 30.0,
    licence: str | None = None,
    share: float = SHARE,
) -> list[Job]:
    """Jobs for dances to every song in ``folder``: groups of all sizes, to parts of ``seconds``.

    With ``augment`` each song has that many further versions (`augment_song`), danced as often.
    All dances to recordings of one title, or to one file under several names, are in one split;
    ``share`` of the titles is expected in "val". Jobs of one song stand far apart, so that several
    workers do not read it at once.

    Raises: ValueError naming the argument, or what is wrong with the folder.
    """
    if operator.index(dances_per_song) < 1:
        raise ValueError(f"dances_per_song={dances_per_song} must be at least 1")
    if operator.index(augment) < 0:
        raise ValueError(f"augment={augment} must be at least 0")
    if not SHORTEST_RECORDED <= seconds < 3600:
        raise ValueError(
            f"seconds={seconds} is no length; choose {SHORTEST_RECORDED:.0f} to an hour"
        )
    if not 0 <= share < 1:
        raise ValueError(f"share={share} is out of range; choose 0 to below 1")
    folder = Path(folder)
    songs = songs_in(folder, licence=licence)
    options = {"seconds": float(seconds), "share": float(share)}
    keys = _together(songs)
    return [
        Job(name, partial(danced_song, song, name, version, k, key=keys[song.key], **options))
        for version, k in itertools.product(range(augment + 1), range(dances_per_song))
        for song in songs
        for name in [f"song_{take_name(song.key[:60])}_{_place(folder, song)}_{version}_{k:02d}"]
    ]


def _together(songs: list[SongFile]) -> dict[str, str]:
    """The key that all songs have which share a title or, under several, a file's content."""
    keys = {song.key: song.key for song in songs}
    first: dict[bytes, str] = {}
    for song in songs:
        with suppress(OSError):  # its dances will tell
            sound = sha256(song.path.read_bytes()).digest()
            old, new = keys[song.key], keys[first.setdefault(sound, song.key)]
            keys = {key: new if one == old else one for key, one in keys.items()}
    return keys


def _place(folder: Path, song: SongFile) -> str:
    """What keeps songs of one title apart: six letters that follow from the place in the folder."""
    return sha256(song.path.relative_to(folder).as_posix().encode()).hexdigest()[:6]


def danced_song(
    song: SongFile, name: str, version: int, k: int, *, key: str, seconds: float, share: float
) -> DanceTake:
    """Dance number ``k`` to a version of a song, 0 being the song itself; group sizes take turns.

    Songs of one ``key`` are in one split.

    Raises: ValueError when the song cannot be read, is silent or shorter than 6 seconds.
    """
    M, steps = _heard(song, version)
    if len(M) < SHORTEST_RECORDED * FPS:
        raise ValueError(
            f"the song lasts {len(M) / FPS:.1f} s; at least {SHORTEST_RECORDED:.0f} s are needed"
        )
    digest = int.from_bytes(sha256(name.encode()).digest()[:8])
    rng = np.random.default_rng(digest)
    f = min(round(seconds * FPS), len(M))
    start = int(rng.integers(0, len(M) - f + 1))
    if k == 0 or rng.random() < BEGINNINGS:
        start = 0
    beats = beat_times(M) - start / FPS
    beats = beats[(beats >= 0) & (beats < f / FPS)]
    n, seed = SIZES[k % len(SIZES)], int(rng.integers(2**31))
    loudness = song_loudness(M)
    options: dict = {
        "seconds": f / FPS,
        "sections": _within(song_sections(M), start / FPS, f / FPS),
        "energy": energy_curve(M, loudness)[start : start + f],
        "genre": any_genre(seed),
    }
    dance, truth = choreograph(beats, dancers=n, seed=seed, **options)
    side = int.from_bytes(sha256(f"song {key}".encode()).digest()[:8])
    return DanceTake(
        name=name,
        dance=dance,
        music="recorded",
        source=f"{song.source}; danced by dancediff's choreographer",
        licence=song.licence,
        split="val" if side < share * 2**64 else "train",
        group=f"song-{key}",
        M=M[start : start + f],
        beats=beats,
        genre=truth.genre,
        loudness=loudness,
        notes={"seed": seed, "start": round(start / FPS, 3), "augmented": steps},
    )


def _within(sections, start: float, seconds: float) -> list[tuple[float, float, str]]:
    """The sections of a part of a song, counted from where the part begins.

    >>> _within([(0.0, 10.0, "intro"), (10.0, 50.0, "verse")], 8.0, 30.0)
    [(0.0, 2.0, 'intro'), (2.0, 30.0, 'verse')]
    """
    moved = ((max(a - start, 0.0), min(b - start, seconds), name) for a, b, name in sections)
    return [(a, b, name) for a, b, name in moved if b > a]


def _heard(song: SongFile, version: int) -> tuple[torch.Tensor, list[str]]:
    """Features of a version of a whole song, and what was changed in it; from the cache if there.

    A song found under another name, or in another folder, has the same versions.
    """
    sound = sha256(song.path.read_bytes()).digest()
    key = content_key("heard", code_digest(("music",)), sound, version)

    @lru_cache
    def made() -> tuple[Music, tuple[str, ...]]:
        music = Music.load(song.path)
        if music.is_silent:
            raise ValueError(f"song {song.path.name!r} is silent")
        if version == 0:
            return music, ()
        rng = np.random.default_rng([version, int.from_bytes(sound[:8])])
        music, change = augment_song(music, rng)
        return music, (f"speed {change.speed:.3f}", *change.steps)

    def words() -> np.ndarray:
        return np.frombuffer(json.dumps(made()[1]).encode(), dtype=np.uint8)

    M = torch.from_numpy(cached(key, lambda: made()[0].features().numpy()))
    return M, json.loads(cached(f"{key}.steps", words).tobytes())
