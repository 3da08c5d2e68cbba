r"""Aligned attention: half of the heads start by attending to the music of their own frame.

$$(R_f v)^\top(R_g v)/\sqrt c = \sum_i w\cos((f-g)\theta_i), \quad \text{largest at } g = f$$

Query and key biases get one shared vector v, so that the logit of frame f for frame g is this
before any content is learned. Without it the network has to discover from noise alone that 150
music tokens belong to 150 frames, which costs a small model most of its training. It is a start:
nothing changes in the network, and training may unlearn it.
"""

import math

import torch
from torch import nn

from dancediff.nn.attention import Attention, rope_frequencies
from dancediff.nn.decoder import DecoderLayer

ALIGNMENT = 8.0  # logit by which a token prefers its own frame
SLOWEST = 0.03  # radians a frame; slower pairs hardly turn within a window and get no bias


def align_attention(model: nn.Module) -> None:
    """Align every cross-attention of a model."""
    for layer in model.modules():
        if isinstance(layer, DecoderLayer):
            align(layer.cross_attention)


@torch.no_grad()
def align(attention: Attention) -> None:
    """Set the biases of half of the heads; the others stay free to attend anywhere.

    >>> attention = Attention(16, num_heads=2)
    >>> align(attention)
    >>> x, frames = torch.zeros(1, 9, 16), torch.arange(9)
    >>> attention.weights(x, x, frames, frames)[0, 0].argmax(-1).equal(frames)
    True
    """
    theta, heads = rope_frequencies(attention.channels), attention.num_heads
    fast = (theta > SLOWEST).float()
    radius = (ALIGNMENT * math.sqrt(attention.channels) / fast.sum()).sqrt() * fast
    aligned = max(1, heads // 2)
    phase = 2 * math.pi * torch.rand(aligned, theta.numel())
    bias = torch.zeros(heads, attention.channels)
    bias[:aligned] = torch.cat([radius * phase.cos(), radius * phase.sin()], dim=-1)
    attention.query.bias.copy_(bias.flatten())
    attention.key_value.bias[: bias.numel()] = bias.flatten()
