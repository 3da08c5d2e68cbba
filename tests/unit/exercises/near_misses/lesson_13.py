"""Plausible wrong answers to the exercises of lesson 13: Can you measure a dance?"""

from dataclasses import replace

import numpy as np
import torch

from dancediff.metrics.rhythm import closeness


def steps(foot):
    return 30 * foot[..., (0, 2)].diff(dim=0)


def both_ways(music, motion):
    """BAS and MMC."""
    return closeness(music, motion, 0.1), closeness(motion, music, 0.1)


def on_the_beat(music, motion):
    """The share of beats with a rest within a tenth of a second."""
    return (np.abs(music[:, None] - motion).min(1) < 0.1).mean()


NEAR_MISSES = {
    "13.1": [
        lambda foot: (steps(foot).mean(-1).abs() > 0.3).any(1),  # the released code
        lambda foot: (steps(foot).abs().mean(-1) > 0.3).any(1),  # no sign, and still no length
        lambda foot: (steps(foot).norm(dim=-1) > 0.3).all(1),  # ankle and toe
        lambda foot: (steps(foot).norm(dim=-1) > 9).any(1),  # frames twice
        lambda foot: (30 * foot.diff(dim=0).norm(dim=-1) > 0.3).any(1),  # lifting is no sliding
        lambda foot: steps(foot).norm(dim=-1) > 0.3,  # one answer each for ankle and toe
        lambda foot: (steps(foot).norm(dim=-1) > 0.3)[:, 0],  # the ankle only
        lambda foot: (steps(foot).norm(dim=-1) > 0.3)[:, 1],
        lambda foot: (steps(foot).abs() > 0.3).any(-1).any(1),  # along x or z alone
        lambda foot: (steps(foot).norm(dim=-1) <= 0.3).any(1),
        lambda foot: steps(foot).mean(1).norm(dim=-1) > 0.3,  # of their middle
    ],
    "13.2": [
        lambda dance: dance,
        lambda dance: dance.joints(),
        lambda dance: dance.frames(0, 1),
        lambda dance: replace(dance, root=2 * dance.root),
        lambda dance: replace(dance, root=dance.root.mean(1, keepdim=True).expand_as(dance.root)),
        lambda dance: replace(dance, root=0 * dance.root),  # the limbs still dance
        lambda dance: replace(dance, pose=dance.pose.flip(1), root=dance.root.flip(1)),
        lambda dance: replace(dance, root=dance.root * float("nan")),
    ],
    "13.3": [
        lambda music, motion: both_ways(music, motion)[0],  # BAS: rests everywhere are perfect
        lambda music, motion: both_ways(music, motion)[1],  # MMC: one rest is enough
        lambda music, motion: sum(both_ways(music, motion)) / 2,
        lambda music, motion: 2 / sum(1 / score for score in both_ways(music, motion)),
        lambda music, motion: min(len(music), len(motion)) / max(len(music), len(motion)),
        on_the_beat,  # BAS again
        lambda music, motion: 0.55,
    ],
    "13.4": [
        {"BAS": False, "PFC": False, "FID_k": False, "Div_k": True},  # a point is a flat cloud
        {"BAS": False, "PFC": False, "FID_k": True, "Div_k": False},
        {"BAS": True, "PFC": False, "FID_k": True, "Div_k": True},
        {"FID_k": True, "Div_k": True},
    ],
    "13.5": [
        lambda dance: dance,
        lambda dance: replace(dance, root=dance.root + torch.tensor([3.0, 0, 0])),  # too near
        lambda dance: replace(dance, root=10 * dance.root),  # faster
        lambda dance: replace(dance, root=dance.root.flip(1) + 30),  # backwards
        lambda dance: replace(dance, root=dance.root + 30 * torch.eye(3)[0]).frames(0, 90),
        lambda dance: dance.joints() + 30,
        lambda dance: replace(dance, root=dance.root * float("nan")),
        lambda dance: replace(dance, pose=dance.pose.flip(0), root=30 + 2 * dance.root),
    ],
}
