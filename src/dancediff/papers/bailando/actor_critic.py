r"""Actor and critic: units that meet the beat are chosen more often.

Read first: Siyao et al. 2022 (Bailando), actor-critic learning.

Symbols (axes: b batch · u units · k frames of a unit)
    r   reward of each unit                             (b, u)
    V   what the critic expects from each time on       (b, u)
"""

import torch
import torch.nn.functional as F
from einops import rearrange, reduce
from torch import Tensor, nn

from dancediff.motion.beats import motion_beats
from dancediff.nn.encoder_layer import EncoderLayer
from dancediff.nn.losses import mean
from dancediff.nn.motion_units import FRAMES
from dancediff.papers.bailando.gpt import STREAMS, CrossConditionalGPT


class Critic(nn.Module):
    """What is to be expected from each time on, read off the features of a `CrossConditionalGPT`.

    Shapes: h (b, 3 u, d) -> V (b, u).

    >>> sizes = {"num_heads": 2, "ff_dim": 32}
    >>> gpt = CrossConditionalGPT(16, num_codes=8, length=6, music_dim=9, num_layers=1,
    ...                           head_layers=1, **sizes)
    >>> Critic(16, num_layers=1, **sizes)(torch.randn(2, 15, 16), gpt).shape
    torch.Size([2, 5])
    """

    def __init__(self, d_model: int, *, num_layers: int, **layer):
        super().__init__()
        self.layers = nn.ModuleList(EncoderLayer(d_model, **layer) for _ in range(num_layers))
        self.norm, self.out = nn.LayerNorm(d_model), nn.Linear(d_model, 1)

    def forward(self, h: Tensor, gpt: CrossConditionalGPT) -> Tensor:
        """The mean over the three tokens of a time."""
        values = self.out(self.norm(gpt.through(self.layers, h)))
        return reduce(values.float(), "b (s u) 1 -> b u", "mean", s=STREAMS)


def has_beat(beats: Tensor) -> Tensor:
    """Which units hold a beat, from 1 at each frame with one: (b, 8 u) -> bool (b, u).

    >>> has_beat(torch.eye(16)[:1]).tolist()
    [[True, False]]
    """
    return rearrange(beats, "b (u k) -> b u k", k=FRAMES).amax(-1) > 0.5


def dance_beats(joints: Tensor) -> Tensor:
    """1 at each frame in which a dancer comes to rest: (b, f, j, 3) metres -> (b, f)."""
    found = torch.zeros(joints.shape[:2])
    for row, one in zip(found, joints, strict=True):
        row[motion_beats(one)] = 1
    return found


def beat_reward(music: Tensor, dance: Tensor) -> Tensor:
    r"""10 (hit - 0.5), where only a unit with a beat of the music can miss.

    $$r = 10\,([\text{dance beat or no music beat}] - 0.5)$$

    Source: Bailando, the beat-align reward.  Differs: the released code gives -5 to every unit
    without a beat of the music, whatever is danced, and has a term for the halves of the body whose
    weight is zero.

    Shapes: bool (b, u) -> (b, u).

    >>> music, dance = torch.tensor([True, True, False, False]), torch.tensor([True, False] * 2)
    >>> beat_reward(music, dance).tolist()
    [5.0, -5.0, 5.0, 5.0]
    """
    return 10 * ((dance | ~music).float() - 0.5)


def td_error(r: Tensor, V: Tensor) -> Tensor:
    r"""$\delta_i = r_i + V_{i+1} - V_i$, with no gradient through $V_{i+1}$; 0 behind the end.

    Source: Bailando, gamma 1.  Shapes: (b, u), (b, u) -> (b, u).

    >>> td_error(torch.tensor([[5.0, -5.0]]), torch.tensor([[1.0, 2.0]])).tolist()
    [[6.0, -7.0]]
    """
    later = F.pad(V.detach()[:, 1:], (0, 1))
    return r + later - V


def actor_critic_losses(logits: Tensor, codes: Tensor, r: Tensor, V: Tensor) -> dict[str, Tensor]:
    r"""What the critic got wrong, and units weighted by how much better they were than expected.

    $$L_{critic} = \mathbb E\,\delta^2, \qquad
      L_{actor} = \mathbb E\,[\text{stop}(\delta)\,(-\log p(a))]$$

    Source: Bailando, actor-critic learning.  Differs: ``codes`` are drawn from p; the released code
    takes the most likely ones, and so never tries another.

    Shapes: logits (b, 2, u, k), codes (b, 2, u), r and V (b, u) -> dict of scalars.
    """
    delta = td_error(r, V)
    surprise = F.cross_entropy(logits.flatten(0, 2), codes.flatten(), reduction="none")
    surprise = surprise.reshape(codes.shape).sum(1)
    return {"critic": mean(delta.square()), "actor": mean(delta.detach() * surprise)}
