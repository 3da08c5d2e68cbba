"""Exercises of lesson 09: Changing places."""

from itertools import pairwise

import torch
import torch.nn.functional as F

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


def _adapt(x_raw, layers, legs):
    steps = x_raw[..., [4, 6]].diff(dim=1)
    v = (30 * F.pad(steps, (0, 0, 1, 0))).clamp(-3, 3)
    x = x_raw
    for k, layer in enumerate(layers):
        x = F.leaky_relu(x) if k else x
        gate = torch.sigmoid(v @ layer["Wg"] + layer["bg"])
        x = (x @ layer["W"] + layer["b"]) * gate + v @ layer["Wb"]
    x_hat = x_raw.clone()
    x_hat[..., legs] = x[..., legs]
    return x_hat


def _adaptor_cases() -> list[tuple]:
    """Some roots are so fast that v is cut."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for n, f, widths, legs in (
        (2, 6, (9, 5, 4, 9), [0, 8, 3]),
        (3, 4, (12, 7, 7, 12), [7, 8, 9, 10, 11]),
        (1, 5, (7, 6, 3, 7), [1, 2]),
    ):
        layers = []
        for wide, out in pairwise(widths):
            sizes = {"W": (wide, out), "b": (out,), "Wg": (2, out), "bg": (out,), "Wb": (2, out)}
            layer = {name: 0.6 * torch.randn(*size, generator=draw) for name, size in sizes.items()}
            layers.append(layer)
        x_raw = torch.randn(n, 1, widths[0], generator=draw).repeat(1, f, 1)
        x_raw += (0.1 * torch.randn(n, f, widths[0], generator=draw)).cumsum(1)
        cases.append((x_raw, layers, legs))
    return cases


SPECS = {
    "09.1": {"spec": _swap_twice, "cases": _swap_pairs},
    "09.2": {"spec": in_order, "cases": _out_of_order, "accepts": _stands_in_order},
    "09.3": {"spec": _floor_velocity, "cases": walks},
    "09.4": {"spec": _adapt, "cases": _adaptor_cases},
}
