r"""Slide loss: a foot that truly stands should not move in the guess.

$$\lVert \hat{\dot f} \cdot [b > 0.5] \rVert^2, \quad \text{(m/s)}^2$$

f are the four joints of the feet, b is the true contact. The papers' contact losses ask the
predicted contact: a guess that denies its contacts escapes them.
"""

from torch import Tensor

from dancediff.axes import FPS
from dancediff.extensions.hard_contact import hard_contact
from dancediff.motion.skeleton import feet_of
from dancediff.nn.losses import Comparison, mean


def slide_loss(c: Comparison) -> Tensor:
    """The mean over feet, axes and frames, a scalar."""
    step = (FPS * feet_of(c.joints)).diff(dim=-3)
    return mean((step * hard_contact(c.contact_0)[..., :-1, :, None]).square())
