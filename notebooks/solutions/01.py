"""Solutions of lesson 01."""

# %% 01.1
# A rotation matrix has rows of length one that stand at right angles. Two of them say it all: the
# third is their cross product. Six numbers that are no such rows yet are pulled straight first.
import torch
from torch.nn.functional import normalize


def six_to_matrix(d6):
    first = normalize(d6[..., :3], dim=-1)
    second = d6[..., 3:] - (first * d6[..., 3:]).sum(-1, keepdim=True) * first
    second = normalize(second, dim=-1)
    return torch.stack([first, second, torch.linalg.cross(first, second)], dim=-2)
