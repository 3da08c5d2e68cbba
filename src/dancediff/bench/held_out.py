"""Held-out windows: parts of takes that a model dances again, to their music, by as many dancers.

Symbols (axes: f frames · m music features)
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.data.prepared import PreparedData
from dancediff.motion.motion import Motion

OVERLAP, SEGMENT = 75, 150
MOST = 5  # dancers in a window


@dataclass
class Window:
    """A part of a held-out take: the dance, the music as the network hears it, beats in seconds."""

    name: str
    kind: str
    motion: Motion
    M: torch.Tensor
    beats: np.ndarray
    genre: str | None = None

    is_silent, peak = False, 1.0  # what `generate` asks a song

    @property
    def duration(self) -> float:
        """In seconds."""
        return len(self.M) / FPS

    @property
    def tempo(self) -> float:
        """Beats a minute."""
        return 60 / float(np.median(np.diff(self.beats)))

    def features(self) -> torch.Tensor:
        """Of the music, (f, m)."""
        return self.M

    def orders(self) -> list[torch.Tensor]:
        """Dancers, numbered from the left, from left to right at the end of every segment."""
        x = self.motion.root[..., 0]
        x = x[x[:, 0].argsort(stable=True)]
        last = x.shape[1] - 1
        count = 1 + max(0, -(-(last + 1 - SEGMENT) // (SEGMENT - OVERLAP)))
        ends = [min(k * (SEGMENT - OVERLAP) + SEGMENT - 1, last) for k in range(count)]
        return [x[:, end].argsort(stable=True) for end in ends]


def windows(
    folder: str,
    frames: int,
    kinds: tuple[str, ...] = ("synthetic", "composed"),
    step: int | None = None,
) -> Iterator[Window]:
    """Windows of the takes that have music, by default one behind the other.

    Of takes with people in them, or made of such takes, only those that training left out.
    """
    data = PreparedData(folder)
    for entry in data:
        if entry.kind not in kinds or (entry.kind != "synthetic" and entry.split == "train"):
            continue
        take = data.load(entry)
        if take.M is None:
            continue
        for start in range(0, take.motion.num_frames - frames + 1, step or frames):
            beats = np.asarray(take.beats) - start / FPS
            yield Window(
                f"{take.name}-{start}",
                take.kind,
                Motion(
                    take.motion.pose[:, start : start + frames],
                    take.motion.root[:, start : start + frames],
                    meta={"kind": take.kind},
                ),
                take.M[start : start + frames],
                beats[(beats >= 0) & (beats < frames / FPS)],
                take.genre,
            )


def chosen(all_of_them: list[Window], count: int, max_dancers: int = MOST) -> list[Window]:
    """So many windows with a beat, spread over the list."""
    usable = [w for w in all_of_them if len(w.beats) and w.motion.num_dancers <= max_dancers]
    picks = np.random.default_rng(0).permutation(len(usable))[:count]
    return [usable[k] for k in sorted(picks)]
