r"""Training windows: five seconds of a group dance and the music it was made for.

Symbols (axes: b batch · n dancers · f frames · d motion, m music features)
    x    motion features of a take, dancers in their own order   (n, f, d)
    M    music features of the take's song                       (f, m)
    x_0  a window, dancers from left to right                    (b, n, f, d)
    S    left-to-right order at the window's last frame          (b, n)
"""

from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context

import numpy as np
import torch
from torch import Tensor
from tqdm.auto import tqdm

from dancediff.data.choreographer import choreograph
from dancediff.motion.representation import TCDIFFPP
from dancediff.music.synth import synth_song


@dataclass(frozen=True)
class Take:
    """One dance with its music; ``name`` says where it comes from."""

    name: str
    x: Tensor
    M: Tensor

    @property
    def num_dancers(self) -> int:
        """Size of the group."""
        return self.x.shape[0]


def rank_left_to_right(x: Tensor) -> tuple[Tensor, Tensor]:
    r"""Put dancers in left-to-right order of the first frame, and tell their order in the last.

    Source: TCDiff++ eq. 5 to 7.  Differs: the released code sorts by the last frame and by depth,
    and then trains on the unsorted dancers.

    Shapes: x (n, f, d) not normalised -> sorted x (n, f, d), S (n,): S[k] is the rank at the first
    frame of the dancer who stands k-th from the left in the last frame.

    >>> x = torch.zeros(2, 2, 151)
    >>> x[:, :, 4] = torch.tensor([[1.0, 0.0], [0.0, 1.0]])        # two dancers change places
    >>> rank_left_to_right(x)[1].tolist()
    [1, 0]
    """
    lateral = TCDIFFPP.root.start
    x = x[x[:, 0, lateral].argsort(stable=True)]
    return x, x[:, -1, lateral].argsort(stable=True)


class GroupDanceWindows:
    """Random windows from takes, a batch at a time, all of one group size.

    ``dancers_per_batch`` keeps the work of a step the same for every group size. The batch of a
    step depends on (seed, step) alone, so a run that resumes sees what it would have seen.

    Raises: ValueError when a take is shorter than a window, or there is none.
    """

    def __init__(self, takes: list[Take], *, num_frames=150, dancers_per_batch=24, seed=0):
        short = [take.name for take in takes if take.x.shape[1] < num_frames]
        if short or not takes:
            raise ValueError(f"takes shorter than {num_frames} frames: {short or 'no takes at all'}")
        self.num_frames, self.dancers_per_batch, self.seed = num_frames, dancers_per_batch, seed
        self.by_size: dict[int, list[Take]] = {}
        for take in takes:
            self.by_size.setdefault(take.num_dancers, []).append(take)

    def batch(self, step: int) -> tuple[Tensor, Tensor, Tensor]:
        """Windows x_0 (b, n, f, d) and M (b, f, m), not normalised, and S (b, n)."""
        rng = np.random.default_rng([self.seed, step])
        n = int(rng.choice(sorted(self.by_size)))
        takes = self.by_size[n]
        windows = [
            self.window(takes[rng.integers(len(takes))], rng)
            for _ in range(max(1, self.dancers_per_batch // n))
        ]
        return tuple(torch.stack(part) for part in zip(*windows, strict=True))

    def window(self, take: Take, rng: np.random.Generator) -> tuple[Tensor, Tensor, Tensor]:
        """One random window of a take: x_0 (n, f, d), M (f, m), S (n,)."""
        start = int(rng.integers(take.x.shape[1] - self.num_frames + 1))
        part = slice(start, start + self.num_frames)
        x_0, S = rank_left_to_right(take.x[:, part])
        return x_0, take.M[part], S


def choreographed_takes(song_seed: int, *, seconds: float = 30.0, sizes=(1, 2, 3, 4, 5)):
    """One synthetic song, danced once by a group of every size; all of it follows from the seed.

    >>> [take.x.shape for take in choreographed_takes(0, seconds=6, sizes=(1, 3))]
    [torch.Size([1, 180, 151]), torch.Size([3, 180, 151])]
    """
    song, truth = synth_song(song_seed, seconds=seconds)
    M = song.features()
    takes = []
    for n in sizes:
        seed = 10 * song_seed + n
        dance, _ = choreograph(truth.beats, dancers=n, seed=seed, seconds=seconds)
        f = min(dance.num_frames, len(M))
        takes.append(Take(f"choreographer-{seed}", dance.features()[:, :f], M[:f].clone()))
    return takes


def _takes_in_worker(seed: int, seconds: float):
    torch.set_num_threads(1)
    return [(take.name, take.x.numpy(), take.M.numpy()) for take in choreographed_takes(seed, seconds=seconds)]


def choreographed_corpus(song_seeds, *, seconds: float = 30.0, workers: int = 2) -> list[Take]:
    """Takes for many songs, made by several processes, in the order of the seeds."""
    takes: list[Take] = []
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        jobs = pool.map(_takes_in_worker, song_seeds, [seconds] * len(song_seeds))
        for parts in tqdm(jobs, total=len(song_seeds), desc="choreographing", unit="song"):
            takes += [Take(name, torch.from_numpy(x), torch.from_numpy(M)) for name, x, M in parts]
    return takes
