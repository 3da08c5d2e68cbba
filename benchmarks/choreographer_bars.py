r"""How the choreographer answers music: one row a genre, and what groups have in common.

    python benchmarks/choreographer_bars.py --data ../shared/data

Twelve songs of 40 s, six synthetic ones and the liveliest stretches of six recordings, are danced
in every genre with their beats and their `energy_curve`. Columns: the correlation of mean joint
speed with energy over windows of 2 s, without energy and with it; slowest and fastest window of
5 s; low feet that stand still; largest root step; smallest distance of two dancers. Below: how
alike the dancers of one group are, and how often it changes formation, in 30 s without energy.

Symbols (axes: n dancers · f frames)
    joints   positions, metres            (n, f, 24, 3)
    energy   of the song, 0..1            (f,)
"""

import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
import tyro
from any_song import SHORT, correlation, in_windows, joint_speed, loudness, moves
from hard_songs import liveliest

from dancediff.data.choreographer import GENRES, DanceTruth, choreograph
from dancediff.data.choreographer.formations import min_distance
from dancediff.metrics.group import gmc
from dancediff.motion.motion import Motion
from dancediff.music.energy import energy_curve
from dancediff.music.song import Music
from dancediff.music.varied import synth_varied_song

SECONDS = 40.0
COLUMNS = ["r without", "r", "slowest", "fastest", "feet still %", "root step cm", "nearest cm"]


@dataclass(frozen=True, eq=False)
class Heard:
    """What the choreographer hears of a song."""

    name: str
    beats: np.ndarray
    energy: np.ndarray
    sections: list | None
    meter: int | None


def songs(data: Path) -> list[Heard]:
    """Six synthetic songs, and six recordings of the folder's ``music``."""
    out = []
    for seed in range(200_000, 200_006):
        music, truth = synth_varied_song(seed, seconds=SECONDS)
        curve = energy_curve(music.features()).numpy()
        out.append(Heard(music.name, truth.beats, curve, truth.sections, truth.meter))
    for path in sorted((data / "music").glob("*.ogg"))[::2][:6]:
        whole = Music.load(path)
        start = liveliest(whole, SECONDS, loudness)
        curve = energy_curve(whole.features()).numpy()
        music = whole.slice(start, start + SECONDS)
        curve = curve[round(30 * start) : round(30 * (start + SECONDS))]
        out.append(Heard(path.stem, music.beats(), curve, None, None))
    return out


def danced(song: Heard, genre: str, dancers: int, seed: int, *, listens: bool) -> Motion:
    """The choreographer's dance to a song."""
    dance, _ = choreograph(
        song.beats, dancers=dancers, seed=seed, seconds=len(song.energy) / 30, genre=genre,
        sections=song.sections, meter=song.meter, energy=song.energy if listens else None,
    )  # fmt: skip
    return dance


def follows(dance: Motion, energy: np.ndarray) -> float:
    """Correlation of joint speed with energy over windows of 2 s."""
    return correlation(in_windows(joint_speed(dance.joints()), SHORT), in_windows(energy, SHORT))


def row(song: Heard, genre: str, dancers: int, seed: int) -> list[float]:
    """One song in one genre."""
    plain, dance = (danced(song, genre, dancers, seed, listens=x) for x in (False, True))
    found = moves(dance, song.beats)
    return [
        follows(plain, song.energy),
        follows(dance, song.energy),
        found.slowest,
        found.fastest,
        100 * found.feet_still,
        100 * found.step,
        100 * float(min_distance(dance.root[..., (0, 2)].numpy())),
    ]


def likeness(dance: Motion) -> float:
    """Mean correlation over time of joint rotations of two dancers of a group."""
    turns = dance.pose[:, :, 1:].flatten(2).double()
    turns = turns - turns.mean(1, keepdim=True)
    size = turns.norm(dim=1)
    pairs = torch.triu_indices(len(turns), len(turns), 1).T.tolist()
    found = []
    for i, j in pairs:
        moved = (size[i] > 0.5) & (size[j] > 0.5)
        both = (turns[i] * turns[j]).sum(0)[moved]
        found.append((both / (size[i] * size[j])[moved]).mean().item())
    return float(np.mean(found))


def not_unison(truth: DanceTruth, num_frames: int) -> float:
    """Share of frames in which a group does not simply dance in unison."""
    stops = [frame for frame, _ in truth.relations[1:]] + [num_frames]
    frames = [
        min(stop, num_frames) - start
        for (start, name), stop in zip(truth.relations, stops, strict=True)
        if name != "unison"
    ]
    return sum(frames) / num_frames


def groups() -> list[tuple[float, ...]]:
    """Likeness, share not in unison, formations, GMC and seconds of computing of 80 dances."""
    out = []
    for k, (name, genre) in enumerate(GENRES.items()):
        beats = np.arange(0.2, 31, 60 / np.mean(genre.tempo))
        for seed in (2, 3, 4, 5, 102, 103, 104, 105):
            n = seed % 100
            begin = time.process_time()
            dance, truth = choreograph(beats, dancers=n, seed=seed + 7 * k, seconds=30, genre=name)
            spent = time.process_time() - begin
            kinds = len({kind for _, kind, _ in truth.formations})
            share = not_unison(truth, dance.num_frames)
            out.append((n, likeness(dance), share, kinds, gmc(dance.joints(), fps=30.0), spent))
    return out


@dataclass
class Args:
    """What to measure."""

    data: Path = Path("../shared/data")
    """Folder with ``music``."""


def main(args: Args) -> None:
    """Print both tables."""
    heard = songs(args.data)
    table = np.array(
        [
            [row(song, genre, 1 + (g + s) % 5, 100 * g + s) for s, song in enumerate(heard)]
            for g, genre in enumerate(GENRES)
        ]
    )
    worst = (np.mean, np.mean, np.min, np.max, np.min, np.max, np.min)
    print("| | " + " | ".join(COLUMNS) + " |\n|" + " --- |" * (1 + len(COLUMNS)))
    rows = {genre: table[g] for g, genre in enumerate(GENRES)}
    rows |= {song.name: table[:, s] for s, song in enumerate(heard)}
    rows |= {"all": table.reshape(-1, len(COLUMNS))}
    for name, cells in rows.items():
        numbers = (f"{pick(cells[:, c]):.3g}" for c, pick in enumerate(worst))
        print(f"| {name} | " + " | ".join(numbers) + " |")
    found = np.array(groups())
    print(f"\nlikeness of two dancers {found[:, 1].mean():.3f}")
    print(f"not in unison {found[:, 2].mean():.3f}")
    for n in (2, 3, 4, 5):
        mine = found[found[:, 0] == n]
        print(f"{n} dancers: formations {mine[:, 3].mean():.2f}, fewest {mine[:, 3].min():.0f}")
    five = found[found[:, 0] == 5]
    print(f"GMC {found[:, 4].mean():.1f}; 30 s of five dancers take {five[:, 5].mean():.3f} s")


if __name__ == "__main__":
    main(tyro.cli(Args))
