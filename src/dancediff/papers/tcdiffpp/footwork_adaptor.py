r"""Footwork Adaptor (FA): make the legs fit the path.

Read first: notebook 09 · TCDiff++ section 4.2, eq. 9-11.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_raw      what the group decoder says, normalised         (b, n, f, 151)
    velocity   ground-plane root velocity of x_raw             (b, n, f, 2)
    x_hat      x_raw with adapted legs                         (b, n, f, 151)
"""

from itertools import pairwise

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dancediff.axes import FPS
from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import LOWER_BODY
from dancediff.nn.conditioning import ConcatSquashLinear

ROOT_ON_FLOOR = TCDIFFPP.floor
FASTEST = 3.0  # normalised units a second: 3 m/s, or the width of the stage in under a second


def ground_velocity(x_raw: Tensor) -> Tensor:
    """How fast the root moves over the floor: x and z, normalised units per second, frame 0 zero.

    Source: TCDiff++ eq. 9.  Differs: the paper's is 3-D; the released code's is per frame, which
    leaves numbers of a few thousandths; here the velocity is cut at 3 units a second.

    Shapes: (b, n, f, d) -> (b, n, f, 2).

    >>> x = torch.zeros(1, 1, 2, 151)
    >>> x[..., 1, 4] = 0.1
    >>> ground_velocity(x)[0, 0].tolist()
    [[0.0, 0.0], [3.0, 0.0]]
    """
    steps = x_raw[..., ROOT_ON_FLOOR].diff(dim=-2)
    # clipped: there is no speed in a noisy guess, and it would saturate every gate
    return (FPS * F.pad(steps, (0, 0, 1, 0))).clamp(-FASTEST, FASTEST)


class FootworkAdaptor(nn.Module):
    r"""Rewrite the leg rotations so that they fit how the body travels.

    $$x_a = \text{CSL}_3(\phi(\text{CSL}_2(\phi(\text{CSL}_1(x_r, v)), v)), v), \qquad
      \hat x = [x_a]_{\text{legs}} \oplus [x_r]_{\text{rest}}$$

    Source: TCDiff++ eq. 9-11; $\phi$ is a leaky ReLU; width 128 as in the released code.
    Differs: the released code also replaces spine1 (joint 3), which is no leg.

    Shapes: x_raw (b, n, f, 151), v (b, n, f, 2) -> (b, n, f, 151).  Units: normalised features.

    >>> x_raw = torch.randn(2, 3, 5, 151)
    >>> x_hat = FootworkAdaptor()(x_raw, ground_velocity(x_raw))
    >>> int((x_hat != x_raw).flatten(0, 2).any(0).sum())             # eight joints of six numbers
    48
    """

    channels: Tensor

    def __init__(self, hidden: int = 128, *, d_cond: int = 2):
        """Three `ConcatSquashLinear` layers; ``d_cond``: width of v."""
        super().__init__()
        channels = torch.tensor(TCDIFFPP.joint_channels(LOWER_BODY))
        self.register_buffer("channels", channels, persistent=False)
        sizes = (TCDIFFPP.dim, hidden, hidden, TCDIFFPP.dim)
        self.layers = nn.ModuleList(
            ConcatSquashLinear(d_in, d_out, d_cond) for d_in, d_out in pairwise(sizes)
        )

    def forward(self, x_raw: Tensor, v: Tensor) -> Tensor:
        """x_raw with adapted legs; in float32, because a degree at the hip is centimetres below."""
        with torch.autocast(x_raw.device.type, enabled=False):
            return self.replace_legs(x_raw, self.adapt(x_raw, v))

    def adapt(self, x_raw: Tensor, v: Tensor) -> Tensor:
        """The adapted motion $x_a$, all channels."""
        first, second, third = self.layers
        x = F.leaky_relu(first(x_raw, v))
        x = F.leaky_relu(second(x, v))
        return third(x, v)

    def replace_legs(self, x_raw: Tensor, adapted: Tensor) -> Tensor:
        """The legs of one motion on the rest of the other."""
        return x_raw.index_copy(-1, self.channels, adapted[..., self.channels])


class NoFootworkAdaptor(nn.Module):
    """In the place of `FootworkAdaptor` where Table 4 leaves it out."""

    def forward(self, x_raw: Tensor, v: Tensor) -> Tensor:
        """x_raw as it is."""
        return x_raw
