r"""EDGE's four losses, which TCDiff, TCDiff++ and GCD keep.

Read first: notebook 05 · EDGE section 3.2 · TCDiff++ section 4.3, eq. 12 to 15.

Symbols (axes: b batch · n dancers · f frames · d motion features · j joints)
    x_0, x_hat   the true motion and a guess, normalised     (b, n, f, d)
    joints       forward kinematics, metres                  (b, n, f, j, 3)
"""

from torch import Tensor

from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import feet_of
from dancediff.nn.losses import mean


def l_simple(x_hat: Tensor, x_0: Tensor) -> Tensor:
    r"""Plain reconstruction: $\operatorname{mean}\,(x_0 - \hat x_0)^2$.

    Source: TCDiff++ eq. 12.  Differs: all losses are means, where the paper prints sums over
    features.  Shapes: (b, n, f, d) normalised -> scalar.

    >>> import torch
    >>> l_simple(torch.ones(1, 2, 3, 4), torch.zeros(1, 2, 3, 4)).item()
    1.0
    """
    return mean((x_hat - x_0).square())


def l_vel(x_hat: Tensor, x_0: Tensor) -> Tensor:
    r"""Change from frame to frame of everything but the contacts.

    $$\operatorname{mean}\,\big((x_{i+1} - x_i) - (\hat x_{i+1} - \hat x_i)\big)^2$$

    Source: TCDiff++ eq. 14.  Differs: the official code leaves the root out; the paper does not.
    Shapes: (b, n, f, d) normalised -> scalar.

    >>> import torch
    >>> l_vel(torch.ones(1, 1, 5, 151), torch.zeros(1, 1, 5, 151)).item()    # a constant offset
    0.0
    """
    moving = slice(TCDIFFPP.root.start, None)
    error = x_hat[..., moving].diff(dim=-2) - x_0[..., moving].diff(dim=-2)
    return mean(error.square())


def l_fk(joints_hat: Tensor, joints_0: Tensor) -> Tensor:
    r"""Where the joints end up: $\operatorname{mean}\,(FK(x_0) - FK(\hat x_0))^2$.

    Source: TCDiff++ eq. 13.  Differs: in metres; the official code runs FK on normalised values.
    Shapes: (b, n, f, j, 3) metres -> scalar.
    """
    return mean((joints_hat - joints_0).square())


def l_contact(joints_hat: Tensor, contact_hat: Tensor) -> Tensor:
    r"""A foot that the dancer calls planted should not move.

    $$\lVert (FK(\hat x)_{i+1} - FK(\hat x)_i) \cdot \hat b_i \rVert^2$$

    Source: TCDiff++ eq. 15.  Differs: a mean over frames, feet and axes; b is the predicted
    contact, as printed; in EDGE's and TCDiff++'s code it is 1 where the scaled contact is above
    0.95, else 0.

    Shapes: joints_hat (b, n, f, j, 3) metres, contact_hat (b, n, f, 4) about 0..1 -> scalar.

    >>> import torch
    >>> joints = torch.arange(3.0)[None, None, :, None, None].expand(1, 1, 3, 24, 3)
    >>> l_contact(joints, torch.full((1, 1, 3, 4), 0.5)).item()      # all move by 1 m a frame
    0.25
    """
    step = feet_of(joints_hat).diff(dim=-3)
    return mean((step * contact_hat[..., :-1, :, None]).square())
