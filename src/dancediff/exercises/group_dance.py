"""Exercises of lessons 05 to 10: the parts of TCDiff++."""

import torch

from dancediff.exercises.exercise import Exercise
from dancediff.tcdiffpp.losses import l_dist


def _distance_loss(p_hat, p):
    return l_dist(p_hat[None], p[None])


def _distance_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = [torch.randn(2, n, 5, 3, generator=draw).unbind() for n in (2, 3, 4)]
    p = cases[-1][1]
    return [*cases, (p + 1.0, p)]  # all stand aside: the offsets are right


def _guide(denoiser, x_t, w):
    without = denoiser(x_t, music=False)
    return without + w * (denoiser(x_t, music=True) - without)


def _guide_cases() -> list[tuple]:
    x_t = torch.randn(2, 3, 4, generator=torch.Generator().manual_seed(0))
    return [(_hears, x_t, w) for w in (0.0, 1.0, 2.0, 0.5)]


def _hears(x_t, music):
    return 0.5 * x_t + 1 if music else 0.3 * x_t - 2


def _ranks(root):
    return root[:, 0, 0].argsort(stable=True).argsort()


def _ranks_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    root = torch.randn(4, 20, 3, generator=draw)
    root[:, 0, 0] = torch.tensor([0.5, 1.5, -1.5, -0.5])  # its order is not its own inverse
    root[:, -1, 0] = torch.tensor([-1.5, 0.5, -0.5, 1.5])
    return [(root,), (root[:3],)]


def _kernel(A, B, C, delta, length):
    k = torch.arange(length)[:, None]
    return (C * torch.exp(delta * A) ** k * delta * B).sum(-1)


def _kernel_cases() -> list[tuple]:
    A, B, C = torch.tensor([[-0.5, -2.0, -8.0], [1.0, 0.5, -2.0], [0.7, 1.0, 0.3]])
    return [(A, B, C, 0.1, 12), (A[:1], B[:1], C[:1], 0.5, 5)]


def _swap_twice(S1, S2):
    return S1[S2]


def _swap_pairs() -> list[tuple]:
    pairs = [([1, 2, 0], [1, 0, 2]), ([0, 2, 1], [2, 0, 1]), ([3, 0, 2, 1, 4], [1, 4, 0, 3, 2])]
    return [(torch.tensor(S1), torch.tensor(S2)) for S1, S2 in pairs]


def _join(segments, overlap):
    return torch.cat([segments[0], *(s[:, overlap:] for s in segments[1:])], dim=1)


def _segments() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((3, 2, 10, 4, 5), (2, 1, 6, 3, 2), (1, 2, 8, 3, 4))  # segments, n, f, d, overlap
    return [(torch.randn(*shape, generator=draw), overlap) for *shape, overlap in sizes]


EXERCISES = {
    "05.1": Exercise(
        "keep your distance",
        _distance_loss,
        "the error of an offset is the difference of two dancers' errors; take each pair of "
        "different dancers once, square, and take the mean over pairs, frames and x, y, z",
        _distance_cases,
    ),
    "06.1": Exercise(
        "listen harder",
        _guide,
        "start from the guess without music and go w times the way to the one with it: w = 0 is "
        "silence, w = 1 plain",
        _guide_cases,
    ),
    "07.1": Exercise(
        "what is my rank?",
        _ranks,
        "the order says who stands k-th; a rank says which k somebody has: the inverse. Look at x, "
        "at the first frame only",
        _ranks_cases,
    ),
    "08.1": Exercise(
        "the memory as a kernel",
        _kernel,
        "follow one pulse: it enters as delta * B, is multiplied by exp(delta * A) once per frame "
        "(not in its own frame), and C reads the sum of all states",
        _kernel_cases,
    ),
    "09.1": Exercise(
        "swap twice",
        _swap_twice,
        "the dancer who is k-th in the end was S2[k]-th in the middle, and S1 says for each place "
        "of the middle who stands there",
        _swap_pairs,
    ),
    "10.1": Exercise(
        "join the segments",
        _join,
        "take the first segment whole, of every later one only what comes behind the overlap, and "
        "join along the frames",
        _segments,
    ),
}
