r"""Training windows: five seconds of a group dance and the music it was made for.

Symbols (axes: b batch · n dancers · f frames · d motion, m music features)
    x    motion features of a take, dancers in their own order   (n, f, d)
    M    music features of the take's song                       (f, m)
    x_0  a window, dancers from left to right                    (b, n, f, d)
    S    left-to-right order at the window's last frame          (b, n)
"""

from dataclasses import dataclass
from hashlib import sha256

import numpy as np
import torch
from torch import Tensor

from dancediff.data.augment import rotate_features, shift_features
from dancediff.motion.mirror import mirror_features
from dancediff.motion.order import left_to_right, swap_mode
from dancediff.motion.representation import TCDIFFPP


@dataclass(frozen=True)
class Take:
    """One dance with its music; ``name`` says where it comes from, ``song`` what it is danced to.

    Takes to one song belong together: they share its beats, so a split must not part them.
    """

    name: str
    x: Tensor
    M: Tensor
    song: str = ""  # "" when no other take has this song
    others: Tensor | None = None  # features of other songs on the same beats (songs, f, m)
    kind: str = "synthetic"  # or "real", "composed"

    @property
    def captured(self) -> bool:
        """Did people dance this, together or not?"""
        return self.kind != "synthetic"

    @property
    def num_dancers(self) -> int:
        """Size of the group."""
        return self.x.shape[0]


def rank_left_to_right(x: Tensor) -> tuple[Tensor, Tensor]:
    r"""Put dancers in left-to-right order of the first frame, and tell their order in the last.

    Source: TCDiff++ eq. 5 to 7, see `dancediff.motion.order`.

    Shapes: x (n, f, d) not normalised -> sorted x (n, f, d), S (n,): S[k] is the rank at the first
    frame of the dancer who stands k-th from the left in the last frame.

    >>> x = torch.zeros(2, 2, 151)
    >>> x[:, :, 4] = torch.tensor([[1.0, 0.0], [0.0, 1.0]])        # two dancers change places
    >>> rank_left_to_right(x)[1].tolist()
    [1, 0]
    """
    lateral = TCDIFFPP.lateral
    x = x[left_to_right(x[:, 0, lateral])]
    return x, swap_mode(x[:, 0, lateral], x[:, -1, lateral])


def ranked_windows(x: Tensor, num_frames: int, stride: int) -> tuple[Tensor, Tensor]:
    """All windows of a take (n, F, d), ``stride`` frames apart, each as `rank_left_to_right` does.

    Shapes: -> x (w, n, f, d), S (w, n).

    >>> x, S = ranked_windows(torch.zeros(2, 9, 151), num_frames=5, stride=2)
    >>> x.shape, S.shape
    (torch.Size([3, 2, 5, 151]), torch.Size([3, 2]))
    """
    starts = range(0, x.shape[1] - num_frames + 1, stride)
    windows = [rank_left_to_right(x[:, start : start + num_frames]) for start in starts]
    return tuple(torch.stack(part) for part in zip(*windows, strict=True))


def order_changes(takes: list[Take], num_frames: int, every: int = 5) -> list[np.ndarray]:
    """Windows in which dancers change their left-to-right order, one array for each new order.

    Looks at every ``every``-th start; an array has rows (number of the take, first frame).

    >>> x = torch.zeros(2, 8, 151)
    >>> x[:, :, 4] = torch.linspace(-1, 1, 8) * torch.tensor([[1.0], [-1.0]])
    >>> order_changes([Take("crossing", x, torch.zeros(8, 35))], num_frames=6)[0].tolist()
    [[0, 0]]
    """
    found: dict[tuple[int, ...], list[tuple[int, int]]] = {}
    for k, take in enumerate(takes):
        lateral = take.x[:, :, TCDIFFPP.lateral]
        starts = torch.arange(0, lateral.shape[1] - num_frames + 1, every)
        orders = swap_mode(lateral[:, starts].T, lateral[:, starts + num_frames - 1].T).tolist()
        for start, order in zip(starts.tolist(), orders, strict=True):
            if order != sorted(order):
                found.setdefault(tuple(order), []).append((k, start))
    return [np.array(found[order]) for order in sorted(found)]


class GroupDanceWindows:
    """Random windows from takes, a batch at a time, all of one group size.

    ``dancers_per_batch`` keeps the work of a step the same for every group size. The batch of a
    step depends on (seed, step) alone, so a run that resumes sees what it would have seen.
    ``captured`` is the share of windows from takes that people danced (real or composed), where a
    group size has both them and synthetic ones; by default every take counts the same.
    ``swaps`` is the share of windows, drawn from all takes of a group size, in which dancers change
    their left-to-right order, every order that occurs as often as any other; the rest falls as it
    may. In a dance most windows keep their order, so by default few show how to change it.

    Augmentation, off by default: ``mirror`` is the share of windows mirrored left to right,
    ``shift`` the largest offset of the whole group along x and along z, in metres, ``rotate`` the
    largest turn of the stage to either side, in radians; ``music`` also plays the other songs that
    fit a take's beats. Dancers are ranked after all that, as the audience then sees them.

    Raises: ValueError when a take is shorter than a window, or there is none.
    """

    def __init__(
        self,
        takes: list[Take],
        *,
        num_frames: int = 150,
        dancers_per_batch: int = 24,
        seed: int = 0,
        mirror: float = 0.0,
        shift: float = 0.0,
        rotate: float = 0.0,
        music: bool = False,
        captured: float | None = None,
        swaps: float = 0.0,
    ):
        if not takes:
            raise ValueError("there are no takes at all to cut windows from; choreograph some")
        short = [take.name for take in takes if take.x.shape[1] < num_frames]
        if short:
            raise ValueError(f"takes shorter than {num_frames} frames: {short}; leave them out")
        if not 0 <= mirror <= 1:
            raise ValueError(f"mirror={mirror} is no share; choose 0 (never) to 1 (always)")
        if not 0 <= shift < float("inf"):
            raise ValueError(f"shift={shift} is no length; choose metres, 0 or more")
        if not 0 <= rotate <= np.pi:
            raise ValueError(f"rotate={rotate} is no angle; choose 0 to pi radians")
        if captured is not None and not 0 <= captured <= 1:
            raise ValueError(f"captured={captured} is no share; choose 0 (never) to 1 (always)")
        if not 0 <= swaps <= 1:
            raise ValueError(f"swaps={swaps} is no share; choose 0 (as it falls) to 1 (always)")
        self.captured, self.swaps = captured, swaps
        self.num_frames, self.dancers_per_batch, self.seed = num_frames, dancers_per_batch, seed
        self.mirror, self.shift, self.rotate, self.music = mirror, shift, rotate, music
        self.by_size: dict[int, list[Take]] = {}
        for take in takes:
            self.by_size.setdefault(take.num_dancers, []).append(take)
        sizes = self.by_size if swaps else ()
        self.changes = {n: order_changes(self.by_size[n], num_frames) for n in sizes}

    def batch(self, step: int) -> tuple[Tensor, Tensor, Tensor]:
        """Windows x_0 (b, n, f, d) and M (b, f, m), not normalised, and S (b, n)."""
        rng = np.random.default_rng([self.seed, step])
        n = int(rng.choice(sorted(self.by_size)))
        takes = self.by_size[n]
        windows = []
        for _ in range(max(1, self.dancers_per_batch // n)):
            orders = None
            if self.changes.get(n) and rng.random() < self.swaps:
                orders = self.changes[n]
            if orders:
                places = orders[rng.integers(len(orders))]
                k, start = places[rng.integers(len(places))]
                windows.append(self.window(takes[k], rng, start=int(start)))
            else:
                windows.append(self.window(self.choose(takes, rng), rng))
        return tuple(torch.stack(part) for part in zip(*windows, strict=True))

    def choose(self, takes: list[Take], rng: np.random.Generator) -> Take:
        """A take at random, with the share of captured ones that was asked for."""
        if self.captured is not None:
            want = rng.random() < self.captured
            takes = [take for take in takes if take.captured == want] or takes
        return takes[rng.integers(len(takes))]

    def window(
        self, take: Take, rng: np.random.Generator, start: int | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """One window of a take, by default at random: x_0 (n, f, d), M (f, m), S (n,)."""
        if start is None:
            start = int(rng.integers(take.x.shape[1] - self.num_frames + 1))
        part = slice(start, start + self.num_frames)
        # ranked last: in the mirror, who stood left stands right
        x_0, S = rank_left_to_right(self.augment(take.x[:, part], rng))
        M = take.M
        if self.music and take.others is not None and len(take.others):
            M = [take.M, *take.others][int(rng.integers(1 + len(take.others)))]
        return x_0, M[part], S

    def augment(self, x: Tensor, rng: np.random.Generator) -> Tensor:
        """Perhaps mirror, turn and shift a window (n, f, d); never changes ``x``."""
        if self.mirror and rng.random() < self.mirror:
            x = mirror_features(x)
        if self.rotate:
            x = rotate_features(x, rng.uniform(-self.rotate, self.rotate))
        if self.shift:
            x = shift_features(x, *rng.uniform(-self.shift, self.shift, 2))
        return x


def split_takes(
    takes: list[Take], *, share: float = 0.1, seed: int = 0
) -> tuple[list[Take], list[Take]]:
    """Training and validation takes; all takes to one song end up on one side.

    The side follows from (seed, song name) alone: a song stays where it is when others are added.
    ``share`` is the expected share of songs in validation; with few songs it may hold none.

    >>> takes = [Take(str(k), torch.zeros(1, 1, 151), torch.zeros(1, 35)) for k in range(100)]
    >>> [len(part) for part in split_takes(takes, share=0.2)]
    [83, 17]
    """
    if not 0 <= share < 1:
        raise ValueError(f"share={share} is out of range; choose 0 to below 1")
    parts: tuple[list[Take], list[Take]] = ([], [])
    for take in takes:
        digest = sha256(f"{seed}:{take.song or take.name}".encode()).digest()
        parts[int.from_bytes(digest[:8]) < share * 2**64].append(take)
    return parts
