"""Plausible wrong answers to the exercises of lesson 09: Changing places."""

from functools import partial
from itertools import pairwise

import torch
import torch.nn.functional as F

from dancediff.exercises import EXERCISES


def as_places(x, S, gap):
    """The places of the guess, given out in the order S; the gap is forgotten."""
    y = x.clone()
    y[S] = x.sort().values
    return y


def evenly(x, S, gap):
    """Right, but moves those who stand well, too."""
    y = x.clone()
    y[S] = x.mean() + gap * (torch.arange(len(x)) - (len(x) - 1) / 2)
    return y


def pushed_right(x, S, gap):
    """In order, but the whole group drifts."""
    y = x.clone()
    for left, right in pairwise(S):
        y[right] = max(x[right], y[left] + gap)
    return y


def with_zeros(steps):
    return torch.cat([torch.zeros_like(steps[:, :1]), steps], dim=1)


def adaptor(x_raw, layers, legs, wrong):
    """Exercise 09.4 with one mistake."""
    root = x_raw[..., [4, 5] if wrong == "height for depth" else [4, 6]]
    steps = (1 if wrong == "per frame" else 30) * root.diff(dim=1)
    v = F.pad(steps, (0, 0, 0, 1) if wrong == "a frame early" else (0, 0, 1, 0))
    v = v if wrong == "not cut" else v.clamp(-3, 3)
    x = x_raw
    for k, layer in enumerate(layers):
        gate = v @ layer["Wg"] + layer["bg"]
        gate = gate if wrong == "no sigma" else gate.sigmoid()
        linear, shift = x @ layer["W"] + layer["b"], v @ layer["Wb"]
        x = (linear + shift) * gate if wrong == "shift gated" else linear * gate + shift
        x = x - shift if wrong == "no shift" else x
        if k < 2 or wrong == "also the last":
            x = {"relu": F.relu, "linear": lambda x: x}.get(wrong, F.leaky_relu)(x)
    if wrong == "all of it":
        return x
    x_hat = x_raw.clone()
    rest = [k for k in range(x.shape[-1]) if k not in legs] if wrong == "the rest" else legs
    x_hat[..., rest] = x[..., rest] + (x_raw[..., rest] if wrong == "added" else 0)
    return x_hat


ADAPTOR_MISTAKES = (
    "height for depth",
    "per frame",  # as in eq. 9
    "a frame early",
    "not cut",
    "no sigma",
    "shift gated",
    "no shift",
    "also the last",  # a leaky ReLU behind the third layer
    "relu",
    "linear",  # nothing between the layers
    "all of it",
    "the rest",  # the legs of the raw guess
    "added",  # ours, not eq. 11
)


NEAR_MISSES = {
    "09.1": [
        lambda S1, S2: S2[S1],  # the wrong way round
        lambda S1, S2: S2,
        lambda S1, S2: S1.argsort()[S2],  # where a rank goes, not who stands in a place
        lambda S1, S2: S1[S2].argsort(),
        lambda S1, S2: (S1 + S2) % len(S1),
        lambda S1, S2: S2.argsort()[S1],
        lambda S1, S2: S1,
        lambda S1, S2: torch.arange(len(S1)),
    ],
    "09.2": [
        as_places,
        evenly,
        pushed_right,
        lambda x, S, gap: x,
        lambda x, S, gap: x[S],
        lambda x, S, gap: evenly(x, S.argsort(), gap),  # the wrong way round
        lambda x, S, gap: EXERCISES["09.2"].spec(x, S, torch.tensor(0.45)),  # the usual gap
        lambda x, S, gap: EXERCISES["09.2"].spec(x, S, 0.9 * gap),
        lambda x, S, gap: EXERCISES["09.2"].spec(x, torch.arange(len(x)), gap),  # S is forgotten
    ],
    "09.3": [
        lambda root: with_zeros(root[..., [0, 2]].diff(dim=1)),  # per frame, as the released code
        lambda root: with_zeros(30 * root[..., :2].diff(dim=1)),  # height for depth
        lambda root: with_zeros(30 * root.diff(dim=1)),  # in space
        lambda root: 30 * root[..., [0, 2]].diff(dim=1),  # a frame is missing
        lambda root: with_zeros(30 * root[..., [0, 2]].diff(dim=1)).roll(-1, dims=1),  # behind
        lambda root: with_zeros(30 * root[..., [0, 2]].diff(dim=1)).norm(dim=-1),  # no direction
        lambda root: with_zeros(30 * root[..., [2, 0]].diff(dim=1)),  # z before x
        lambda root: with_zeros(-30 * root[..., [0, 2]].diff(dim=1)),
        lambda root: torch.cat([x[:, :1] for x in [30 * root[..., [0, 2]].diff(dim=1)]] * 1, 1),
    ],
    "09.4": [
        *(partial(adaptor, wrong=wrong) for wrong in ADAPTOR_MISTAKES),
        lambda x_raw, layers, legs: adaptor(x_raw, layers, legs, "")[..., legs],
        lambda x_raw, layers, legs: x_raw,
    ],
}
