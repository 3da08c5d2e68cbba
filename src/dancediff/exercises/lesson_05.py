"""Exercises of lesson 05: A denoiser that listens."""

import torch

from dancediff.exercises.shared import unlike, walks
from dancediff.papers.tcdiffpp.losses import l_dist


def _distance_loss(p_hat, p):
    return l_dist(p_hat[None], p[None])


def _distance_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = [torch.randn(2, n, 5, 3, generator=draw).unbind() for n in (2, 3, 4)]
    p = cases[-1][1]
    return [*cases, (p + 1.0, p)]  # all stand aside: the offsets are right


def _strangers(p):
    return p + torch.tensor([10.0, 0, 0]) * torch.arange(len(p))[:, None, None]


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


SPECS = {
    "05.2": {"spec": _distance_loss, "cases": _distance_cases},
    "05.3": {"spec": _strangers, "cases": walks, "accepts": _fools_released_loss},
}
