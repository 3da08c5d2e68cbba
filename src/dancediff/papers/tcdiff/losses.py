r"""The losses of TCDiff: of the paths, and of the bodies on them.

Read first: Dai et al. 2025 (TCDiff) sections 3.2 and 3.3 · `dancediff.nn.motion_losses`.

Symbols (axes: b batch · n dancers · f frames · j joints)
    path   places on the floor, normalised x and z    (b, n, f, 2)
"""

from dataclasses import asdict, dataclass

from torch import Tensor

from dancediff.nn.losses import Comparison, between_pairs, mean
from dancediff.nn.motion_losses import l_contact, l_fk, l_simple, l_vel


@dataclass(frozen=True)
class TCDiffWeights:
    """Weight of each term: TCDiff's released code.

    >>> TCDiffWeights().terms()["path_distance"]
    2.0
    """

    simple: float = 0.636  # reconstruction
    vel: float = 2.964  # change from frame to frame
    fk: float = 0.646  # where joints are, from the root
    contact: float = 10.942  # feet that stand still
    path: float = 1.0  # the navigator's places
    path_distance: float = 2.0  # its distances between dancers
    path_velocity: float = 2.0  # its changes from frame to frame

    def terms(self) -> dict[str, float]:
        """The weights by the name of their term."""
        return asdict(self)


def body_losses(c: Comparison) -> dict[str, Tensor]:
    """The terms of the bodies, unweighted and by name; joints count from the root.

    Source: TCDiff section 3.3.
    """
    relative, relative_0 = c.joints - c.root[..., None, :], c.joints_0 - c.root_0[..., None, :]
    return {
        "simple": l_simple(c.x_raw, c.x_0),
        "vel": l_vel(c.x_hat, c.x_0),
        "fk": l_fk(relative, relative_0),
        "contact": l_contact(c.joints, c.contact),
    }


def path_losses(guess: Tensor, truth: Tensor) -> dict[str, Tensor]:
    r"""Places, distances of all pairs of dancers, and velocities.

    $$\lVert p - \hat p \rVert^2, \quad
      \lVert (p_i - p_j) - (\hat p_i - \hat p_j) \rVert^2, \quad
      \lVert \dot p - \dot{\hat p} \rVert^2$$

    Source: TCDiff section 3.2.  Differs: all pairs count; in the released code, neighbours only.

    Shapes: (b, n, f, 2), both -> dict of scalars.

    >>> import torch
    >>> path = torch.randn(1, 3, 9, 2)
    >>> path_losses(path + 1, path)["path_distance"].item() < 1e-12      # the whole group shifted
    True
    """
    error = guess - truth
    return {
        "path": mean(error.square()),
        "path_distance": mean(between_pairs(error).square()),
        "path_velocity": mean(error.diff(dim=2).square()),
    }
