"""Solutions of lesson 11."""

# %% 11.1
# The inner frames are compared with both neighbours at once. ">" on one side and "<=" on the other
# count a flat valley once, at its first frame.


def valleys(v):
    below = (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])
    return 1 + below.nonzero()[:, 0]


# %% 11.2
# Joint k is k / 24 of the way from one rest to the next, so at every moment another one rests and
# the others move on: their mean hardly changes. Lodge's rests are rests of the whole body; a wave
# that runs through it has none, however clearly every part of it stops.
import torch


def ripple(frames):
    when = torch.arange(frames)[:, None] / 30 + torch.arange(24) / 24
    joints = torch.zeros(frames, 24, 3)
    joints[..., 0] = 0.2 * torch.sin(torch.pi * when)
    return joints


# %% 11.3
# A border is a multiple of n, counted in frames of the clip and not of a local. Only so do the two
# halves of a hard primitive lie in two locals, and only then do neighbours fit together.
def hard_frames(N, n):
    middles = [4, *range(n, N, n), N - 4]
    return [[middle + i for i in range(-4, 4)] for middle in middles]


# %% 11.4
# Each primitive loses the place of its own first frame, on the floor only: times (1, 0, 1) leaves
# heights alone. Nothing is written into root, so the clip it was cut from stays whole.


def forget(root):
    floor = root.new_tensor([1.0, 0.0, 1.0])
    return root - root[:, :1] * floor


# %% 11.5
# The clock decides where hard primitives lie, the dancer where soft ones do. Their number is fixed,
# because the network has room for thirteen: each half of a local gives the rest with most movement
# around it, or its middle. What happens in any of them is always the dancer's.
changes = {
    "how many soft ones": False,
    "frames of the soft ones": True,
    "frames of the hard ones": False,
    "poses in the hard ones": True,
}


# %% 11.6
# Borders come first: they do not depend on the dance. Then each half of a local takes the rest with
# most movement around it, if one is free, so soft primitives are spread over time and never lie over
# each other. A gap without any rest is filled all the same: the network has 13 places.
def plan(rests, energy, N, n):
    middles = [4]
    for border in range(0, N, n):
        first, last = border + 12, border + n - 12
        for half in (border, border + n // 2):
            here = [b for b in rests if half <= b < half + n // 2]
            fit = [b for b in here if first <= b <= last]
            middles.append(max(fit, key=lambda b: energy[b]) if fit else half + n // 4)
            first = middles[-1] + 8
        middles.append(min(border + n, N - 4))
    return [[middle + i for i in range(-4, 4)] for middle in middles]
