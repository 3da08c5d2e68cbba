r"""Joint velocity loss: the joints of a guess should move as fast as the true ones.

$$\lVert \dot J - \hat{\dot J} \rVert^2, \quad \text{(m/s)}^2$$

TCDiff++'s velocity loss (eq. 14) counts the numbers of the motion vector, in which a tremble of the
hip, which shakes the whole leg, is one of 147.

Source: Lodge eq. 5, for whose stages it is a term of the paper.
"""

from torch import Tensor

from dancediff.axes import FPS
from dancediff.nn.losses import Comparison, mean


def joint_velocity_loss(c: Comparison) -> Tensor:
    """The mean over joints, axes and frames, a scalar."""
    return mean((FPS * c.joints.diff(dim=-3) - FPS * c.joints_0.diff(dim=-3)).square())
