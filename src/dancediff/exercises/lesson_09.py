"""Exercises of lesson 09: Changing places."""

import torch

from dancediff.exercises.shared import unlike, walks
from dancediff.extensions.order_constraint import in_order
from dancediff.motion.representation import TCDIFFPP
from dancediff.papers.tcdiffpp.footwork_adaptor import ground_velocity


def _swap_twice(S1, S2):
    return S1[S2]


def _swap_pairs() -> list[tuple]:
    pairs = [([1, 2, 0], [1, 0, 2]), ([0, 2, 1], [2, 0, 1]), ([3, 0, 2, 1, 4], [1, 4, 0, 3, 2])]
    return [(torch.tensor(S1), torch.tensor(S2)) for S1, S2 in pairs]


def _out_of_order() -> list[tuple]:
    cases = [
        ([-1.0, 0.2, 1.1], [2, 1, 0], 0.45),
        ([0.3, 0.0, -0.2, 0.1], [1, 3, 0, 2], 0.6),
        ([-0.8, 0.1, 0.9], [0, 1, 2], 0.45),  # all is well
        ([0.9, -1.4, 0.1], [1, 2, 0], 0.8),  # here, too, just
        ([0.3, 0.0, -0.35], [2, 1, 0], 0.3),  # and here; the usual gap would move them
        ([0.0, 0.1], [0, 1], 0.45),
    ]
    return [(torch.tensor(x), torch.tensor(S), gap) for x, S, gap in cases]


def _stands_in_order(got, x, S, gap) -> str:
    if wrong := unlike(got, x.shape):
        return wrong
    room = got[S].diff().min().item()
    if room < gap - 1e-3:
        return f"from left to right {S.tolist()} there are {room:.2f} m to the next, expected {gap}"
    if abs(got.mean() - x.mean()) > 1e-3:
        return f"the group's middle goes from {x.mean():.2f} to {got.mean():.2f} m"
    if x[S].diff().min() >= gap and (got - x).abs().max() > 1e-3:
        return "these stand in order with room, and are moved nevertheless"
    return ""


def _floor_velocity(root):
    x = root.new_zeros(*root.shape[:-1], TCDIFFPP.dim)
    x[..., TCDIFFPP.root] = root
    return ground_velocity(x)


SPECS = {
    "09.1": {"spec": _swap_twice, "cases": _swap_pairs},
    "09.2": {"spec": in_order, "cases": _out_of_order, "accepts": _stands_in_order},
    "09.3": {"spec": _floor_velocity, "cases": walks},
}
