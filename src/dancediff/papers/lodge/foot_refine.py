r"""Foot Refine Block: look at where the feet really are, and correct the motion.

Read first: notebook 12 · Lodge section 3.4, "Foot Refine Block" · notebook 01 for FK.

A small turn at the hip moves a foot by centimetres, so whether a foot slides cannot be read off the
rotations. The block computes it and attends to it.

Symbols (axes: b batch · f frames · d motion features)
    x_raw      what the decoder says, normalised                           (b, f, 139)
    joints     forward kinematics of it, metres                           (b, f, 24, 3)
    features   of the four foot joints, left and right ankle, left and right toe   (b, f, 48)
    delta      the correction                                             (b, f, 139)
"""

import torch
from torch import Tensor, nn

from dancediff.axes import FPS, ON_FLOOR
from dancediff.lookup import table
from dancediff.motion.contact import feet_low
from dancediff.motion.skeleton import feet_of
from dancediff.nn.attention import full_precision
from dancediff.nn.decoder import DecoderLayer, frames_of_memory, read_out

FEATURES = 48  # 4 joints x 4 quantities x 3 numbers
SCORE_HEIGHT = (0.12, 0.12, 0.08, 0.08)  # metres above the floor: ankles, toes
SCORE_SPEED = 0.01  # metres a frame in the floor plane
STEEPNESS = 5.0
FASTEST = 3.0  # m/s: behind a noisy guess stands no speed


def step_of(feet: Tensor) -> Tensor:
    """How far foot joints (..., f, 4, 3) move until the next frame; the last frame repeats."""
    if feet.shape[-3] == 1:
        return torch.zeros_like(feet)
    step = feet.diff(dim=-3)
    return torch.cat([step, step[..., -1:, :, :]], dim=-3)


def contact_score(height: Tensor, speed: Tensor) -> Tensor:
    r"""How planted a foot is: 1 on the floor and at rest, 0 high up or fast, smooth in between.

    $$c = \sigma\Big(5\,\frac{h_0 - h}{h_0}\Big)\,\sigma\Big(5\,\frac{v_0 - v}{v_0}\Big)$$

    Source: Lodge's code, after Zhang et al. 2023.  Differs: that code has negative thresholds for a
    floor at -1.2 m, while its data have theirs at 0; the first factor is then always 0.99. Here
    h_0 is 0.12 m (ankles) and 0.08 m (toes), v_0 is 0.01 m a frame.

    Shapes: height, speed (..., 4), metres above the floor and metres a frame -> (..., 4).

    >>> height, speed = torch.tensor([0.0, 0.12, 0.0, 0.5]), torch.tensor([0.0, 0.0, 0.1, 0.0])
    >>> contact_score(height, speed).round(decimals=2)     # planted, on the verge, sliding, lifted
    tensor([0.9900, 0.5000, 0.0000, 0.0000])
    """
    low = table(torch.tensor, SCORE_HEIGHT, like=height)
    near = torch.sigmoid(STEEPNESS * (low - height) / low)
    return near * torch.sigmoid(STEEPNESS * (SCORE_SPEED - speed) / SCORE_SPEED)


def foot_features(joints: Tensor) -> Tensor:
    """What the feet do: on the floor or not, how surely, where, and how fast.

    Source: Lodge section 3.4 (contact score, foot position, foot velocity) and its code, which adds
    the label.  Differs: the floor is at height 0, as in the data, not at -1.2 m; velocity is in
    m/s and cut at 3, where the code has metres a frame, that is, thousandths.
    Label and score of a joint stand there three times, as in the code, so that all four quantities
    are 3-vectors and the map that reads them has the published number of weights.

    Shapes: joints (..., f, 24, 3) metres -> (..., f, 48): label, score, position, velocity.

    >>> foot_features(torch.zeros(5, 24, 3)).shape
    torch.Size([5, 48])
    """
    feet = feet_of(joints)
    step = step_of(feet)
    label = feet_low(joints).to(feet)
    score = contact_score(feet[..., 1], step[..., ON_FLOOR].norm(dim=-1))
    thrice = [a[..., None].expand(feet.shape) for a in (label, score)]
    velocity = (FPS * step).clamp(-FASTEST, FASTEST)
    return torch.cat([*thrice, feet, velocity], dim=-2).flatten(-2)


class FootRefine(nn.Module):
    r"""One decoder layer that attends to the feet.

    $$\text{delta} = W_o\,\text{layer}(W_q\, x_r,\; \text{LN}[W_k\,\text{feet}(x_r),\, t],\; c),
      \qquad \hat x = x_r + \text{delta}$$

    Source: Lodge section 3.4.  Differs: in the released code this stack has no layer (its layer is
    appended to the decoder), so that the feet never reach the output; here it is a real one. The
    correction is near zero before training.

    Shapes: x_raw (b, f, 139), features (b, f, 48), steps (b, 2, d_model), cond (b, d_model)
    -> delta (b, f, 139).

    >>> refine = FootRefine(16, num_heads=2, ff_dim=32)
    >>> x_raw, features = torch.randn(2, 9, 139), torch.randn(2, 9, 48)
    >>> refine(x_raw, features, torch.randn(2, 2, 16), torch.randn(2, 16)).shape
    torch.Size([2, 9, 139])
    """

    def __init__(
        self,
        d_model: int,
        *,
        num_heads: int,
        ff_dim: int,
        motion_dim: int = 139,
        dropout: float = 0.0,
    ):
        """One map each for motion, feet and correction, and one `DecoderLayer`."""
        super().__init__()
        self.embed = nn.Linear(motion_dim, d_model)
        self.embed_feet = nn.Linear(FEATURES, d_model)
        self.norm_memory = nn.LayerNorm(d_model)
        self.layer = DecoderLayer(d_model, num_heads=num_heads, ff_dim=ff_dim, dropout=dropout)
        self.out = nn.Linear(d_model, motion_dim)
        with torch.no_grad():
            for weights in self.out.parameters():
                weights.mul_(0.01)

    def forward(self, x_raw: Tensor, features: Tensor, steps: Tensor, cond: Tensor) -> Tensor:
        """Every frame attends to its feet and to those of frames around it."""
        f = x_raw.shape[1]
        frames = torch.arange(f, device=x_raw.device)
        memory = self.norm_memory(
            torch.cat([full_precision(self.embed_feet(features)), steps], dim=1)
        )
        of_tokens = frames_of_memory(memory.shape[1], frames)  # feet belong to frames as music does
        h = self.layer(full_precision(self.embed(x_raw)), memory, cond, frames, of_tokens)
        return read_out(self.out, h)


class NoFootRefine(nn.Module):
    """In the place of the block in a network without it (Table 5): no correction."""

    def __init__(self, *sizes, **options):
        """It has no weights."""
        super().__init__()

    def forward(self, x_raw: Tensor, features: Tensor, steps: Tensor, cond: Tensor) -> Tensor:
        """Zeros."""
        return torch.zeros_like(x_raw)
