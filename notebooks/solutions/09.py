"""Solutions of lesson 09."""

# %% 09.1
# S2 names the dancers by their rank in the middle, and S1 says who had which rank there. So S1,
# read at the places S2 asks for, goes from the end through the middle to the start.


def both(S1, S2):
    return S1[S2]


# %% 09.2
# From left to right everybody stays in place unless somebody is in the way, so who stands in order
# is not touched. The middle is kept by a shift of all. The library moves them by the least squares.
from itertools import pairwise


def in_order(x, S, gap):
    y = x.clone()
    for left, right in pairwise(S):
        y[right] = max(x[right], y[left] + gap)
    return y + (x - y).mean()


# %% 09.3
# Eq. 9 wants a velocity: per second it is of the size of the other numbers, and the same at any
# frame rate. On the floor a jump is no step, so the height does not count.
import torch


def floor_velocity(root):
    steps = 30 * root[..., [0, 2]].diff(dim=1)
    return torch.cat([torch.zeros_like(steps[:, :1]), steps], dim=1)


# %% 09.4
# The gate lets a layer do one thing while the body travels and another while it stands. All three
# layers see the whole pose, but only the legs are taken from what they make of it.
import torch.nn.functional as F


def adapt(x_raw, layers, legs):
    steps = x_raw[..., [4, 6]].diff(dim=1)
    v = (30 * F.pad(steps, (0, 0, 1, 0))).clamp(-3, 3)
    x = x_raw
    for k, layer in enumerate(layers):
        gate = (v @ layer["Wg"] + layer["bg"]).sigmoid()
        x = (x @ layer["W"] + layer["b"]) * gate + v @ layer["Wb"]
        if k < 2:
            x = F.leaky_relu(x)
    x_hat = x_raw.clone()
    x_hat[..., legs] = x[..., legs]
    return x_hat
