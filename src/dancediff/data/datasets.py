r"""Windows of prepared takes as torch data sets: for groups (TCDiff++) and for long solos (Lodge).

A window never crosses takes, and takes were split before windows are cut: no frame of validation is
seen in training. The random changes of a window follow from (seed, epoch, window) alone.

Symbols (axes: N largest group · n dancers · f frames · d motion, m music features)
    x        motion vectors, not normalised, absent dancers zero    (N, f, d)
    present  who is there                                           (N,)
    S        left-to-right order at the last frame; absent last     (N,)
    M        music features, raw                                    (f, m)
"""

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import Dataset

from dancediff.data.augment import rotate_features
from dancediff.data.packed import PackedTakes
from dancediff.data.prepared import PreparedData
from dancediff.data.windows import rank_left_to_right
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE


@dataclass(frozen=True)
class Augmentation:
    """How windows are changed at random; nothing by default.

    mirror  share of windows mirrored left to right
    rotate  largest turn of the stage to either side, radians
    music   take any of the songs that fit the take's beats, not always the first

    Raises: ValueError naming the value.
    """

    mirror: float = 0.0
    rotate: float = 0.0
    music: bool = False

    def __post_init__(self):
        if not 0 <= self.mirror <= 1:
            raise ValueError(f"mirror={self.mirror} is no share; choose 0 (never) to 1 (always)")
        if not 0 <= self.rotate <= np.pi:
            raise ValueError(f"rotate={self.rotate} is no angle; choose 0 to pi radians")

    def motion(self, x: Tensor, rng: np.random.Generator) -> Tensor:
        """Perhaps mirror and turn a window (n, f, d); never changes ``x``."""
        if self.mirror and rng.random() < self.mirror:
            x = mirror_features(x)
        if self.rotate:
            x = rotate_features(x, rng.uniform(-self.rotate, self.rotate))
        return x

    def song(self, M: Tensor, rng: np.random.Generator) -> Tensor:
        """One of the songs; (songs, f, m) -> (f, m)."""
        return M[int(rng.integers(len(M)))] if self.music else M[0]


class _Windows(Dataset):
    """Windows of one length from packed takes."""

    def __init__(self, data, split, num_frames, stride, keep, augmentation, seed):
        for name, value in (("num_frames", num_frames), ("stride", stride)):
            if value < 1:
                raise ValueError(f"{name}={value} must be at least 1")
        data = data if isinstance(data, PreparedData) else PreparedData(data)
        self.packed = PackedTakes(data, split)
        self.num_frames, self.seed, self.epoch = num_frames, seed, 0
        self.augmentation = augmentation or Augmentation()
        entries = [place.entry for place in self.packed.places]
        self.left_out = self.packed.left_out + [e.name for e in entries if not keep(e)]
        self.windows = np.array(
            [
                (k, start)
                for k, entry in enumerate(entries)
                if keep(entry)
                for start in range(0, entry.frames - num_frames + 1, stride)
            ],
            dtype=np.int64,
        ).reshape(-1, 2)

    def __len__(self) -> int:
        return len(self.windows)

    def set_epoch(self, epoch: int) -> None:
        """Draw other random changes than in the epoch before."""
        self.epoch = epoch

    def names(self) -> list[str]:
        """Names of the takes that windows come from."""
        return [self.packed.places[k].entry.name for k in np.unique(self.windows[:, 0])]

    def _cut(self, k: int):
        """Take, motion (n, f, d) and music (f, m) of window k, changed at random."""
        if not -len(self) <= k < len(self):
            raise IndexError(f"window {k} of {len(self)}")
        k = k % len(self)
        take, start = map(int, self.windows[k])
        rng = np.random.default_rng([self.seed, self.epoch, k])
        part = (take, start, start + self.num_frames)
        x = self.augmentation.motion(self.packed.motion(*part), rng)
        M = self.augmentation.song(self.packed.music(*part), rng)
        return self.packed.places[take].entry, x, M.clone(), rng


class GroupDanceDataset(_Windows):
    """Five-second windows of groups of 1 to ``max_dancers``, dancers from left to right.

    Source: TCDiff++ section 5.1 (150 frames, every 15).  Differs: one set for all group sizes, with
    a mask; the order is that of the window's first frame, found after mirroring and turning.

    Items: x (N, f, d), M (f, m), S (N,), present (N,) bool. ``left_out`` names the takes that are
    too short, too large or without music. An empty split gives an empty set.

    Raises: ValueError when the folder is not prepared.
    """

    def __init__(
        self,
        data: PreparedData | str,
        split: str = "train",
        *,
        num_frames: int = 150,
        stride: int = 15,
        max_dancers: int = 5,
        augmentation: Augmentation | None = None,
        seed: int = 0,
    ):
        self.max_dancers = max_dancers
        super().__init__(data, split, num_frames, stride, self._keep, augmentation, seed)

    def _keep(self, entry) -> bool:
        return entry.frames >= self.num_frames and entry.dancers <= self.max_dancers

    def __getitem__(self, k: int) -> dict[str, Tensor]:
        """Window k."""
        _, x, M, _ = self._cut(k)
        x, S = rank_left_to_right(x)
        n, absent = len(x), self.max_dancers - len(x)
        return {
            "x": torch.cat([x, x.new_zeros(absent, *x.shape[1:])]),
            "M": M,
            "S": torch.cat([S, torch.arange(n, n + absent)]),
            "present": torch.arange(self.max_dancers) < n,
        }


class LongDanceDataset(_Windows):
    """Windows for Lodge's two stages: ``lengths`` = frames of the global and of the local stage.

    Source: Lodge section 4.1 (1024 and 256 frames); (512, 128) is for shorter takes. A take that is
    shorter than the global length serves the local stage only.

    Items: x (f, 139), M (f, m), genre (a number in ``genres``, -1 if unknown). With ``groups``
    every dancer of a group counts as a solo, one drawn at random for each window; by default only
    solos do.

    Raises: ValueError for another stage, or lengths that are not increasing.
    """

    def __init__(
        self,
        data: PreparedData | str,
        split: str = "train",
        *,
        stage: str = "local",
        lengths: tuple[int, int] = (1024, 256),
        stride: int | None = None,
        groups: bool = False,
        augmentation: Augmentation | None = None,
        seed: int = 0,
    ):
        if stage not in ("global", "local"):
            raise ValueError(f"stage={stage!r} is not one of 'global', 'local'")
        if not lengths[0] > lengths[1] > 0:
            raise ValueError(f"lengths={lengths} must be those of the global and the local stage")
        data = data if isinstance(data, PreparedData) else PreparedData(data)
        self.stage, self.groups = stage, groups
        # of all splits, so that a number means the same in each of them
        self.genres = sorted({entry.genre for entry in data if entry.genre})
        frames = lengths[0] if stage == "global" else lengths[1]
        stride = lengths[1] // 4 if stride is None else stride
        super().__init__(data, split, frames, stride, self._keep, augmentation, seed)

    def _keep(self, entry) -> bool:
        return entry.frames >= self.num_frames and (self.groups or entry.dancers == 1)

    def __getitem__(self, k: int) -> dict[str, Tensor]:
        """Window k."""
        entry, x, M, rng = self._cut(k)
        dancer = int(rng.integers(len(x))) if len(x) > 1 else 0
        genre = self.genres.index(entry.genre) if entry.genre else -1
        x = x[dancer, :, : LODGE.dim].clone()
        return {"x": x, "M": M, "genre": torch.tensor(genre)}
