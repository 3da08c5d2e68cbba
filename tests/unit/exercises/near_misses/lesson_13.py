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


def root(S):
    values, vectors = torch.linalg.eigh(S)
    return vectors * values.clamp_min(0).sqrt() @ vectors.T


def crowds(*, standard=None, cov=None, shared=None, apart=None, weight=2):
    """FID with one part replaced; with none it is right."""

    def by_reference(x, r):
        deviation = r.std(0, correction=0)
        deviation[deviation < 1e-8] = 1
        return (x - r.mean(0)) / deviation, (r - r.mean(0)) / deviation

    standard = standard or by_reference
    cov = cov or (lambda x: x.T.cov())
    shared = shared or (lambda S, S_r: root(root(S) @ S_r @ root(S)).trace())
    apart = apart or (lambda x, r: (x.mean(0) - r.mean(0)).square().sum())

    def answer(x, r):
        x, r = standard(x, r)
        S, S_r = cov(x), cov(r)
        return apart(x, r) + S.trace() + S_r.trace() - weight * shared(S, S_r)

    return answer


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
    "13.6": [
        crowds(standard=lambda x, r: (x, r)),  # metres count for more than what hardly moves
        crowds(standard=lambda x, r: ((x - x.mean(0)) / x.std(0), (r - r.mean(0)) / r.std(0))),
        crowds(standard=lambda x, r: (x / r.std(), r / r.std())),  # one scale for all numbers
        crowds(  # a number that is constant in the reference is all that is left
            standard=lambda x, r: tuple(
                (v - r.mean(0)) / (r.std(0, correction=0) + 1e-10) for v in (x, r)
            )
        ),
        crowds(cov=lambda x: x.T @ x / len(x)),  # not around the mean
        crowds(cov=lambda x: torch.diag(x.var(0))),  # numbers do not vary together
        crowds(cov=lambda x: x.T.corrcoef().nan_to_num()),
        crowds(cov=lambda x: x.T.cov(correction=0)),  # divided by N, not N - 1
        crowds(shared=lambda S, S_r: (S @ S_r).clamp_min(0).sqrt().trace()),  # entry by entry
        crowds(shared=lambda S, S_r: (root(S) @ root(S_r)).trace()),  # as if they commuted
        crowds(shared=lambda S, S_r: root(S @ S_r).trace()),  # eigh reads one triangle only
        crowds(shared=lambda S, S_r: (root(S) @ S_r @ root(S)).trace()),  # no root
        crowds(apart=lambda x, r: (x.mean(0) - r.mean(0)).norm()),  # not squared
        crowds(apart=lambda x, r: (x.mean(0) - r.mean(0)).square().mean()),
        crowds(apart=lambda x, r: 0),  # clouds of one shape, wherever they are
        crowds(weight=1),
    ],
}
