r"""Collision avoidance: while a dance is sampled, dancers who would collide make room.

Read first: notebook 10 · `dancediff.extensions.constraint` · `dancediff.metrics.collision`.

Symbols (axes: n dancers · f frames · j joints · p pairs of dancers)
    gap     between the nearest joints of two dancers, less their girths, metres   (p, f)
    way     unit vector on the floor along which a pair parts                     (p, f, 2)
    push    how far a dancer is asked to step aside, metres                       (n, f, 2)

Where two bodies of a guess overlap, the guess is conditioned on both standing a little further
apart: a whole path or place moves while there is much noise, and nothing at the end, where the
network has settled what feet do.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.axes import ON_FLOOR
from dancediff.diffusion.long_sampling import Segment
from dancediff.extensions.constraint import Constraint
from dancediff.metrics.collision import CAPSULES
from dancediff.motion.representation import TCDIFFPP, Normalizer, joints_of
from dancediff.motion.skeleton import SMPL24

ROOM = 0.15  # metres left between two joints, girths apart; between joints a limb has none
SLACK = 0.012  # metres: once guesses are surer than this, nobody is moved any more
SAYS_WHERE = 0.03  # abar from which a guess says where somebody stands
EVERY = 5  # frames between those that are looked at
PASSING = 0.5  # m/s: who passes another faster than this steps aside, not back
INSIDE = {"belly": "abdomen", "lhand": "left hand", "rhand": "right hand"}  # no capsule ends there
X, Z = range(TCDIFFPP.dim)[TCDIFFPP.floor]


def girths() -> Tensor:
    """Of every joint, the largest radius of a capsule that ends there or holds it, metres (24,)."""
    radius = torch.zeros(SMPL24.num_joints)
    for name, inside in INSIDE.items():
        radius[SMPL24.index(name)] = next(r for capsule, _, _, r in CAPSULES if capsule == inside)
    for _, a, b, r in CAPSULES:
        for j in (a, b):
            if j < len(radius):
                radius[j] = max(radius[j].item(), r)
    return radius


def pushes(joints: Tensor, fps: float = 30.0) -> Tensor:
    r"""How far everybody should step aside, where two bodies are too near (n, f, 2), x and z.

    $$\Delta_i = \tfrac12 \sum_j [\text{room} - \text{gap}_{ij}]_+\,u_{ij}$$

    u points from j to i; for a pair that passes by, across the way on which they pass.

    Shapes: joints (n, f, 24, 3) metres -> (n, f, 2) metres, zero where there is room.

    >>> joints = torch.zeros(2, 30, 24, 3)
    >>> joints[1, ..., 0] = 0.2                      # far too near: both step aside, along x
    >>> pushes(joints)[:, 0].sign().tolist()
    [[-1.0, 0.0], [1.0, 0.0]]
    """
    n, f = joints.shape[:2]
    i, j = torch.triu_indices(n, n, 1)
    size = girths().to(joints)
    gap = torch.cdist(joints[i], joints[j]) - (size[:, None] + size)
    lack = (ROOM - gap.flatten(2).amin(2)).clamp_min(0)  # (p, f)
    root = joints[:, :, 0][..., ON_FLOOR]
    apart = root[i] - root[j]
    past = torch.gradient(apart, dim=1)[0] * fps if f > 1 else torch.zeros_like(apart)
    speed = past.norm(dim=-1, keepdim=True)
    across = torch.stack([-past[..., 1], past[..., 0]], -1) / speed.clamp_min(1e-6)
    side = (apart * across).sum(-1, keepdim=True)
    across = across * torch.where(side < 0, -1.0, 1.0)
    straight = apart / apart.norm(dim=-1, keepdim=True).clamp_min(1e-6)
    way = torch.where(speed > PASSING, across, straight)
    half = lack[..., None] * way / 2
    push = torch.zeros(n, f, 2).to(joints)
    return push.index_add(0, i.to(joints.device), half).index_add(0, j.to(joints.device), -half)


@dataclass(frozen=True)
class CollisionAvoidance:
    """A `Source` of `ConstraintHook`: where two are too near, both are asked to step aside.

    >>> two = torch.zeros(2, 30, 151)
    >>> two[1, ..., X] = 0.2                                     # metres: far too near
    >>> hook = CollisionAvoidance(Normalizer(-torch.ones(151), torch.ones(151)))
    >>> hook.at(two, 0.5).mask.any(-1).sum().item()
    12
    """

    normalizer: Normalizer

    def for_segment(self, segment: Segment) -> "CollisionAvoidance":
        """The same for every segment."""
        return self

    def at(self, guess: Tensor, abar: float) -> Constraint | None:
        """Where everybody is asked to stand (n, f, d), or None if there is room."""
        if abar <= SAYS_WHERE or len(guess) < 2:
            return None
        part = self.normalizer.unnormalize(guess[:, ::EVERY])
        push = pushes(joints_of(part, TCDIFFPP), fps=30 / EVERY)
        if not push.any():
            return None
        moved = torch.zeros(guess.shape[:2], dtype=torch.bool)
        moved[:, ::EVERY] = push.abs().sum(-1) > 0
        mask = torch.zeros_like(guess, dtype=torch.bool)
        mask[..., X] = mask[..., Z] = moved
        scale = self.normalizer.scale.to(guess)
        value = guess.clone()
        value[:, ::EVERY, X] += push[..., 0] / scale[X]
        value[:, ::EVERY, Z] += push[..., 1] / scale[Z]
        return Constraint(mask, value, torch.full_like(guess, SLACK) / scale)
