"""Solutions of lesson 13."""


# %% 13.1
# The length of a step, whatever its direction. The signed mean of x and z is 0 along one diagonal,
# 0.71 of the length along the other and half of it along x or z, so that code asks a foot which way
# it slides. A lifted foot does not slide: y is left out.
def skates(foot):
    speed = 30 * foot[..., (0, 2)].diff(dim=0).norm(dim=-1)
    return (speed > 0.3).any(dim=1)


# %% 13.2
# PFC weighs how hard the root accelerates with how far the feet travel. A statue does neither, so
# its PFC is 0, the best there is. It has no moment of rest between two movements either: BAS is 0.
from dataclasses import replace


def cheat(dance):
    pose = dance.pose[:, :1].expand_as(dance.pose).clone()
    return replace(dance, pose=pose, root=dance.root[:, :1].expand_as(dance.root).clone())


# %% 13.3
# The lower of the two: who wants a high score must be good at both. A product does as well. A mean
# does not, nor the harmonic mean of F-scores: of rests everywhere half lie near some beat by chance
# alone (MMC 0.49), and BAS is 1.
from dancediff.metrics.rhythm import closeness


def rhythm(music, motion):
    return min(closeness(music, motion, 0.1), closeness(motion, music, 0.1))


# %% 13.4
# Each of the sixty is a good dance, so whatever looks at dances one by one is content. Only a
# metric of the set sees that there is but one: its cloud is a point, which is far from a round one,
# and no two dances lie apart.
notices = {"BAS": False, "PFC": False, "FID_k": True, "Div_k": True}


# %% 13.5
# In the published formula most of a place survives the subtraction: (1/dt - 1) p / dt, which is 870
# m/s^2 for every metre from the middle of the room. Speeds and true accelerations know differences only,
# so a dance that is moved as a whole is the same dance to them.
import dataclasses


def elsewhere(dance):
    root = dance.root.clone()
    root[..., 0] += 30
    return dataclasses.replace(dance, root=root)


# %% 13.6
# The product of two covariances is not symmetric, but the product with one root on each side is,
# and has the same eigenvalues; the trace of a root is the sum of their roots. A flat cloud only has
# eigenvalues of 0 more, which rounding may put a little below: without a clamp they become nan.
from torch import linalg, where


def frechet(x, r):
    mean, deviation = r.mean(0), r.std(0, correction=0)
    deviation = where(deviation < 1e-8, 1.0, deviation)
    x, r = (x - mean) / deviation, (r - mean) / deviation

    def root(S):
        values, vectors = linalg.eigh(S)
        return vectors * values.clamp_min(0).sqrt() @ vectors.T

    S, S_r = x.T.cov(), r.T.cov()
    shared = root(root(S) @ S_r @ root(S))
    apart = (x.mean(0) - r.mean(0)).square().sum()
    return apart + (S + S_r - 2 * shared).trace()
