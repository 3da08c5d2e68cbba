r"""EDGE: the transformer that TCDiff++ and Lodge build on; it knows one dancer and the music.

Read first: notebook 05 · Tseng et al. 2023 (EDGE) section 3.

Symbols (axes: b batch · n dancers · f frames · d motion, m music features)
    x_t    noisy motion, normalised            (b, n, f, d)
    x_hat  the guess                           (b, n, f, d)

A group is n dancers who do not know of each other: that makes it the baseline of a group model.
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.decoder import DanceDecoder, check_shapes

SPACING = 1.2  # metres between the start slots, about as in the training data


@dataclass(frozen=True)
class EDGEConfig:
    """Sizes; plain values, so that it can be stored as JSON.

    The defaults are as small as those of TCDiff++; `paper` has the published sizes.

    >>> EDGEConfig.paper().d_model
    512
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    num_layers: int = 4  # of the decoder
    ff_dim: int = 512  # width inside a feed-forward block
    max_dancers: int = 10  # who find a place on the stage; the network knows one
    num_frames: int = 150  # of one segment: 5 seconds
    motion_dim: int = 151  # features of a dancer's frame
    music_dim: int = 35  # features of a frame of music
    dropout: float = 0.0  # share of values that are set to zero in training
    cond_drop: float = 0.25  # share of windows in training whose music is masked
    num_steps: int = 1000  # noise levels

    @classmethod
    def paper(cls, **changes) -> "EDGEConfig":
        """Sizes of EDGE: 8 layers, 8 heads, width 512; 47,024,791 weights with 35-d music."""
        sizes = {"d_model": 512, "num_heads": 8, "num_layers": 8, "ff_dim": 1024, "dropout": 0.1}
        return cls(**sizes | changes)


class EDGE(DanceNetwork):
    r"""A transformer decoder for one dancer: self-attention, cross-attention, feed-forward, FiLM.

    $$\hat x = \text{decoder}(x_t, t, M)$$

    Source: EDGE section 3.  Differs: positions are rotated after the projection, head by head, as
    everywhere here; music is the 35-d features instead of Jukebox's 4800; the contact loss counts
    the predicted contact, as printed, where the code cuts it at 0.95, and joints are in metres.
    Trained with TCDiff++'s loop, whose weights for EDGE's four losses are EDGE's; L_D is zero for
    one dancer.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music -> x_hat (b, n, f, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> model = EDGE(EDGEConfig(d_model=16, num_layers=1, ff_dim=32))
    >>> x_t, conditions = torch.randn(2, 3, 20, 151), Conditions(torch.randn(2, 20, 35))
    >>> model(x_t, torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 20, 151])
    """

    config: EDGEConfig

    def __init__(self, config: EDGEConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or EDGEConfig()
        super().__init__(c.motion_dim, c.music_dim, c.num_steps)
        self.config = c
        self.decoder = DanceDecoder.of(c, c.num_frames)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean dance; every dancer is a row of the batch."""
        return self.guess(*self.alone(x_t, t, conditions)).reshape(x_t.shape)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess, (b, n, f, d)."""
        return self(x_t, t, conditions)

    def guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean motion of single dancers, (b, f, d)."""
        return self.decoder.read(self.decode(self.decoder.embed(x_t), t, conditions))

    def decode(self, h: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """All layers, (b, f, d_model) -> the same."""
        music, steps, cond = self.decoder.condition(t, conditions)
        return self.decoder(h, [music, steps], cond, torch.arange(h.shape[1], device=h.device))

    def alone(self, x_t: Tensor, t: Tensor, conditions: Conditions):
        """The arguments of `forward`, with every dancer as a row of the batch."""
        shape, c = tuple(x_t.shape), self.config
        if len(shape) != 4 or shape[3] != c.motion_dim or not 1 <= shape[2] <= c.num_frames:
            raise ValueError(
                f"x_t has shape {shape}; expected (b, n, f, d) with f <= {c.num_frames}, "
                f"d = {c.motion_dim}"
            )
        b, n, f, _ = shape
        check_shapes(t=(t, (b,)), music=(conditions.music, (b, f, c.music_dim)))
        rows = replace(conditions, swap=None).each_row(n)
        return x_t.flatten(0, 1), t.repeat_interleave(n, 0), rows


def start_slots(n: int) -> Tensor:
    """Places in a row, left to right, (n, 1, 3) metres.

    >>> start_slots(3)[:, 0, 0]
    tensor([-1.2000,  0.0000,  1.2000])
    """
    slots = torch.zeros(n, 1, 3)
    slots[:, 0, 0] = SPACING * (torch.arange(n) - (n - 1) / 2)
    return slots


def moved(x: Tensor, way: Tensor) -> Tensor:
    """Move dancers (n, f, d) over the floor by (n, 1, 3); heights stay."""
    x = x.clone()
    x[..., TCDIFFPP.root] += way * way.new_tensor([1.0, 0.0, 1.0])
    return x
