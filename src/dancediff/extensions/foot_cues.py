r"""Foot cues: where the feet of a guess are, and how fast they move, for a network to read.

Symbols (axes: b batch · n dancers · f frames · d motion features · 4 ankles and toes)
    x     a guess of the motion, normalised                            (b, n, f, d)
    rel   feet seen from the root, metres                              (b, n, f, 12)
    y     height of the feet, in units of 20 cm                        (b, n, f, 4)
    v     velocity of the feet, metres a second, 0 in the last frame   (b, n, f, 12)
"""

import torch
from torch import Tensor, nn

from dancediff.axes import FPS
from dancediff.extensions.parts import Part, Pass
from dancediff.motion.representation import Normalizer, unpack
from dancediff.motion.skeleton import feet_of, forward_kinematics

HEIGHTS = 5.0  # a foot on the floor against one at 20 cm
SLOW = 8.0  # what a second look at the velocity is multiplied with: it ends at about 12 cm/s
NUM_CUES = 40
NUM_MOVING = 28  # the last of them: heights and velocities


@torch.no_grad()
def foot_cues(x: Tensor, normalizer: Normalizer) -> Tensor:
    r"""What forward kinematics says about the feet of a guess.

    $$[\,p_\text{foot} - p_\text{root},\; 5 y,\; v,\; \tanh 8 v\,], \qquad v = 30\,(p_{i+1} - p_i)$$

    Whether a foot stands is a matter of millimetres between nine rotations and the root; a small
    network does not find that function by itself, but can use its result.

    Lodge's foot refine block reads such numbers after the network. No gradient goes
    through them.

    Shapes: x (b, n, f, 151) normalised -> (b, n, f, 40).

    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> foot_cues(torch.zeros(1, 2, 5, 151), norm).shape
    torch.Size([1, 2, 5, 40])
    """
    with torch.autocast(x.device.type, enabled=False):
        _, root, pose = unpack(normalizer.unnormalize(x.float()))
        feet = feet_of(forward_kinematics(pose, root))
    seen = (feet - root[..., None, :]).flatten(-2)
    v = torch.zeros_like(feet)
    v[:, :, :-1] = FPS * feet.diff(dim=2)
    v = v.flatten(-2)
    return torch.cat([seen, HEIGHTS * feet[..., 1], v, (SLOW * v).tanh()], dim=-1)


class FootCues(Part):
    """The network, and the Footwork Adaptor, read the foot cues; needs preconditioning.

    The adaptor must be built for ``NUM_MOVING`` more conditions.
    """

    def __init__(self, d_model: int):
        super().__init__()
        self.embed_cues = nn.Linear(NUM_CUES, d_model)

    def embed(self, h: Tensor, run: Pass) -> Tensor:
        """Embed those of the linear guess beside the motion."""
        return h + self.embed_cues(foot_cues(run.guess, run.normalizer))

    def velocity(self, v: Tensor, x_raw: Tensor, run: Pass) -> Tensor:
        """Heights and velocities of the feet beside the velocity of the root."""
        return torch.cat([v, foot_cues(x_raw, run.normalizer)[..., -NUM_MOVING:]], dim=-1)
