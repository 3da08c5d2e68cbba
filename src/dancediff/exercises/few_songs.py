r"""A few synthetic songs and dances of three to them: what lesson 16 trains on and measures with.

Read first: lesson 16 · `dancediff.data.choreographed`.

Symbols (axes: b songs · n dancers · f frames · d motion, m music features)
    x    dances, dancers from left to right   (b, n, f, d)
    S    their order in the end               (b, n)
    M    the music                            (b, f, m)
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.data.choreographed import choreographed_takes, genre_and_tempo
from dancediff.data.take import DanceTake
from dancediff.data.windows import rank_left_to_right
from dancediff.metrics.collision import tif
from dancediff.metrics.physical import fsr
from dancediff.metrics.rhythm import beat_alignment
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.music.song import Music
from dancediff.music.synth import synth_song

STEPS = 40  # of training, unless lesson 16 sets another number
DANCERS = 3
FRAMES = 90  # of a window: 3 s
TRAIN_SECONDS, TEST_SECONDS = 10.0, 6.0  # of a song
FIRST_TEST_SONG = 900  # no training comes so far
SCORES = ("MMC", "FSR", "TIF", "m/s")


def training_takes(songs: int) -> list[DanceTake]:
    """A dance of three to each of the first synthetic songs.

    >>> [take.x.shape for take in training_takes(1)]
    [torch.Size([3, 300, 151])]
    """
    return [_take(seed, TRAIN_SECONDS) for seed in range(songs)]


def _take(seed: int, seconds: float) -> DanceTake:
    return choreographed_takes(seed, seconds=seconds, sizes=(DANCERS,))[0]


@dataclass(frozen=True)
class UnheardSongs:
    """Songs that no training has, each with the choreographer's own dance to its first 3 s."""

    seeds: tuple[int, ...]
    x: Tensor
    S: Tensor
    M: Tensor
    beats: tuple[np.ndarray, ...]  # of each song, seconds

    @property
    def truth(self) -> list[Motion]:
        """The choreographer's dances."""
        return [Motion.from_features(x) for x in self.x]

    def sound(self, k: int) -> Music:
        """The k-th song, to be heard or danced to."""
        seed = self.seeds[k]
        return synth_song(seed, seconds=TEST_SECONDS, tempo=genre_and_tempo(seed)[1])[0]

    def scores(self, dances: Iterable[Motion]) -> np.ndarray:
        """`SCORES` of a dance to each song, (b, 4): on the beat, skating, collisions, speed.

        Every dancer's lowest toe or ankle is put on the floor first; skating is nan where feet
        still do not come down to it.
        """
        rows = []
        for dance, beats in zip(dances, self.beats, strict=True):
            joints = on_the_floor(dance.joints())
            on_beat = beat_alignment(joints, beats, direction="motion")
            speed = FPS * joints.diff(dim=1).norm(dim=-1).mean().item()
            rows.append((on_beat, _skating(joints), tif(joints), speed))
        return np.array(rows)


def on_the_floor(joints: Tensor) -> Tensor:
    """Move each dancer up or down until the lowest foot stands at 0 once, (n, f, j, 3) metres.

    >>> on_the_floor(torch.ones(1, 2, 24, 3))[..., 1].max().item()
    0.0
    """
    lowest = joints[:, :, FOOT_JOINTS, 1].amin((1, 2))
    return joints - lowest[:, None, None, None] * joints.new_tensor([0.0, 1.0, 0.0])


def _skating(joints: Tensor) -> float:
    try:
        return fsr(joints)
    except ValueError:  # no foot is on the floor, so none skates there
        return float("nan")


def score_table(scores: dict[str, np.ndarray], trained: dict[str, str]) -> str:
    """The mean of each row's dances that have the score, and how long it was trained.

    >>> print(score_table({"mine": np.array([[0.5, np.nan, 0.0, 1.0]])}, {"mine": "9 s"}))
                        MMC     FSR     TIF     m/s  trained
    mine              0.500       -   0.000   1.000  9 s
    """
    lines = [f"{'':15}{''.join(f'{name:>8}' for name in SCORES)}  trained"]
    for name, values in scores.items():
        columns = [column[np.isfinite(column)] for column in values.T]
        cells = [f"{column.mean():8.3f}" if len(column) else f"{'-':>8}" for column in columns]
        lines.append(f"{name:15}{''.join(cells)}  {trained[name]}")
    return "\n".join(lines)


def unheard_songs(count: int) -> UnheardSongs:
    """The first ``count`` songs to measure with.

    >>> songs = unheard_songs(1)
    >>> tuple(songs.x.shape), songs.scores(songs.truth).shape
    ((1, 3, 90, 151), (1, 4))
    """
    seeds = tuple(range(FIRST_TEST_SONG, FIRST_TEST_SONG + count))
    takes = [_take(seed, TEST_SECONDS) for seed in seeds]
    x, S = zip(*(rank_left_to_right(take.x[:, :FRAMES]) for take in takes), strict=True)
    M = torch.stack([take.M[:FRAMES] for take in takes if take.M is not None])
    beats = [np.asarray(take.beats) for take in takes]
    heard = tuple(times[times < FRAMES / FPS] for times in beats)
    return UnheardSongs(seeds, torch.stack(x), torch.stack(S), M, heard)
