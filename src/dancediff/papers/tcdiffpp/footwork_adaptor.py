r"""Footwork Adaptor (FA): make the legs fit the path.

Read first: notebook 09 · TCDiff++ section 4.3, eq. 9-11.

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
from dancediff.motion.representation import TCDIFFPP, MotionSpec
from dancediff.motion.skeleton import LOWER_BODY

LEAK = 0.01  # slope of LeakyReLU below zero

FASTEST = 3.0  # normalised units a second: the width of the stage in less than a second


class ConcatSquashLinear(nn.Module):
    r"""A linear layer whose output a condition gates and shifts.

    $$\text{CSL}(x, c) = (W x + b) \odot \sigma(W_g c + b_g) + W_b c$$

    Source: TCDiff++ section 4.3, after Grathwohl et al. 2019 (FFJORD).

    Shapes: x (..., d_in), c (..., d_cond) -> (..., d_out).

    >>> ConcatSquashLinear(4, 6, 2)(torch.randn(3, 4), torch.randn(3, 2)).shape
    torch.Size([3, 6])
    """

    def __init__(self, d_in: int, d_out: int, d_cond: int):
        """Gate and shift start at zero: first the layer is half a linear map."""
        super().__init__()
        self.linear = nn.Linear(d_in, d_out)
        self.gate = nn.Linear(d_cond, d_out)
        self.shift = nn.Linear(d_cond, d_out, bias=False)
        for parameter in (*self.gate.parameters(), *self.shift.parameters()):
            nn.init.zeros_(parameter)

    def forward(self, x: Tensor, c: Tensor) -> Tensor:
        """See the equation."""
        return self.linear(x) * torch.sigmoid(self.gate(c)) + self.shift(c)


def ground_velocity(x_raw: Tensor, spec: MotionSpec = TCDIFFPP) -> Tensor:
    """How fast the root moves over the floor: x and z, normalised units per second, frame 0 zero.

    Source: TCDiff++ eq. 9.  Differs: the paper's is 3-D; the released code's is per frame, which
    leaves numbers of a few thousandths.

    Shapes: (b, n, f, d) -> (b, n, f, 2).

    >>> x = torch.zeros(1, 1, 2, 151)
    >>> x[..., 1, 4] = 0.1
    >>> ground_velocity(x)[0, 0].tolist()
    [[0.0, 0.0], [3.0, 0.0]]
    """
    lateral, _height, depth = x_raw[..., spec.root].unbind(-1)
    path = torch.stack([lateral, depth], dim=-1)
    # cut off: behind a noisy guess stands no speed, and it would saturate every gate
    return (FPS * F.pad(path.diff(dim=-2), (0, 0, 1, 0))).clamp(-FASTEST, FASTEST)


class FootworkAdaptor(nn.Module):
    r"""Rewrite the leg rotations so that they fit how the body travels.

    $$x_a = \text{CSL}_3(\phi(\text{CSL}_2(\phi(\text{CSL}_1(x_r, v)), v)), v), \qquad
      \hat x = [x_a]_{\text{legs}} \oplus [x_r]_{\text{rest}}$$

    Source: TCDiff++ eq. 9-11; three layers and width 128 as in the released code.
    Differs: the released code also replaces spine1 (joint 3), which is no leg. No path leads around
    the three layers, so they start as the identity on the legs (`start_as_identity`).

    Shapes: x_raw (b, n, f, 151) -> (b, n, f, 151).  Units: normalised features.

    >>> x_raw = torch.randn(2, 3, 5, 151)
    >>> torch.allclose(FootworkAdaptor()(x_raw), x_raw, atol=1e-5)       # before training
    True
    """

    def __init__(
        self,
        hidden: int = 128,
        *,
        spec: MotionSpec = TCDIFFPP,
        joints=LOWER_BODY,
        residual: bool = False,
        cues: int = 0,
    ):
        """Three `ConcatSquashLinear` layers; with ``residual`` (ours) they add a correction.

        ``cues`` (ours): how many more numbers a frame they listen to, see `foot_cues`.
        """
        super().__init__()
        self.residual = residual
        self.spec = spec
        self.register_buffer(
            "channels", torch.tensor(spec.joint_channels(joints)), persistent=False
        )
        sizes = (spec.dim, hidden, hidden, spec.dim)
        self.layers = nn.ModuleList(
            ConcatSquashLinear(d_in, d_out, 2 + cues) for d_in, d_out in pairwise(sizes)
        )
        if residual:
            self.start_small()
        elif hidden >= 2 * len(self.channels):
            self.start_as_identity()

    @torch.no_grad()
    def start_small(self) -> None:
        """Hardly any correction before training."""
        for weights in self.layers[-1].parameters():
            weights.mul_(0.01)

    @torch.no_grad()
    def start_as_identity(self) -> None:
        r"""Choose weights with which the legs pass unchanged through the three layers.

        $\phi(x) - \phi(-x) = (1 + 0.01)\,x$ for LeakyReLU $\phi$, so a pair of hidden units carries
        one leg channel; the gates start at one half. The other units start at random.
        Without this the network must first learn to copy 48 numbers, to a degree or two at the
        ankle, before it can improve on them.
        """
        k = len(self.channels)
        plus, minus = torch.arange(k), torch.arange(k) + k
        first, second, third = (layer.linear for layer in self.layers)
        for layer in (first, second):
            layer.weight[: 2 * k] = 0
            layer.bias[: 2 * k] = 0
        third.weight[self.channels] = 0
        third.bias[self.channels] = 0
        first.weight[plus, self.channels] = 2
        first.weight[minus, self.channels] = -2
        carry = 2 / (1 + LEAK)
        for rows, sign in ((plus, 1), (minus, -1)):
            second.weight[rows, plus] = sign * carry
            second.weight[rows, minus] = -sign * carry
        third.weight[self.channels, plus] = carry
        third.weight[self.channels, minus] = -carry

    def adapt(self, x_raw: Tensor, cues: Tensor | None = None) -> Tensor:
        """The adapted motion $x_a$, all channels."""
        v = ground_velocity(x_raw, self.spec)
        v = v if cues is None else torch.cat([v, cues], dim=-1)
        first, second, third = self.layers
        x = F.leaky_relu(first(x_raw, v), LEAK)
        x = F.leaky_relu(second(x, v), LEAK)
        return x_raw + third(x, v) if self.residual else third(x, v)

    def forward(self, x_raw: Tensor, cues: Tensor | None = None) -> Tensor:
        """x_raw with adapted legs; in float32, because a degree at the hip is centimetres below."""
        with torch.autocast(x_raw.device.type, enabled=False):
            x_raw = x_raw.float()
            adapted = self.adapt(x_raw, cues)
        return x_raw.index_copy(-1, self.channels, adapted[..., self.channels])
