"""Exercises of lesson 05: A denoiser that listens."""

import math

import torch
import torch.nn.functional as F

from dancediff.exercises.shared import unlike, walks
from dancediff.papers.tcdiffpp.losses import l_dist


def _distance_loss(p_hat, p):
    return l_dist(p_hat[None], p[None])


def _distance_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = [torch.randn(2, n, 5, 3, generator=draw).unbind() for n in (2, 3, 4)]
    p = cases[-1][1]
    return [*cases, (p + 1.0, p)]  # all stand aside: the offsets are right


def _rooms() -> list[tuple]:
    """Walks, and two who stand in a row, the first 2, 4 or 5 m to the right of the second."""
    row = torch.ones(3, 2, 30, 3)
    row[:, 0, :, 0] += torch.tensor([2.0, 4.0, 5.0])[:, None]
    return [*walks(), *((p,) for p in row)]


def _strangers(p):
    return p + torch.tensor([11.0, 0, 0]) * torch.arange(len(p))[:, None, None]  # over 2 * 5 m


def _fools_released_loss(got, p) -> str:
    if wrong := unlike(got, p.shape):
        return wrong
    noticed = (got - p).diff(dim=1).square().mean().item()  # frames of one dancer
    if noticed > 1e-6:
        return f"the released loss is {noticed:.2g}, expected less than 0.000001"
    i, j = torch.triu_indices(len(p), len(p), 1)
    apart, true = ((x[i] - x[j]).norm(dim=-1) for x in (got, p))
    least = (apart - true).abs().min().item()
    return "" if least >= 0.5 else f"a distance is wrong by {least:.2f} m only, expected 0.5 m"


def _layer(h, memory, c, W):
    def attend(x, m, maps):
        Q, K, V = x @ maps[0], m @ maps[1], m @ maps[2]
        return (Q @ K.mT / math.sqrt(Q.shape[-1])).softmax(-1) @ V

    blocks = (
        lambda x: attend(x, x, W["self"]),
        lambda x: attend(x, memory, W["cross"]),
        lambda x: F.gelu(x @ W["in"]) @ W["out"],
    )
    for block, film in zip(blocks, W["film"], strict=True):
        gamma, beta = (F.mish(c) @ film).chunk(2)
        h = h + (1 + gamma) * block(F.layer_norm(h, h.shape[-1:])) + beta
    return h


def _layer_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = []
    for tokens, k, d in ((5, 3, 4), (2, 7, 6)):
        h, memory, c = (torch.randn(*size, generator=draw) for size in ((tokens, d), (k, d), (d,)))
        sizes = {"self": (3, d, d), "cross": (3, d, d), "in": (d, 4 * d), "out": (4 * d, d)}
        sizes |= {"film": (3, d, 2 * d)}
        W = {name: 0.5 * torch.randn(*size, generator=draw) for name, size in sizes.items()}
        cases.append((h, 2 * memory + 1, c, W))
    return cases


SPECS = {
    "05.2": {"spec": _distance_loss, "cases": _distance_cases},
    "05.3": {"spec": _strangers, "cases": _rooms, "accepts": _fools_released_loss},
    "05.4": {"spec": _layer, "cases": _layer_cases},
}
