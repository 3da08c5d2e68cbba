r"""TCDiff++: a song in, a group dance out.

Read first: notebook 10 · TCDiff++ sections 3 and 4.

Symbols (axes: b batch · n dancers · f frames · d motion, m music features)
    x_raw, x_hat   the guess before and after the Footwork Adaptor   (b, n, f, d)
    abar           $\bar\alpha_t$, signal kept after t steps         (T,)
"""

from dataclasses import dataclass

from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.sizes import check_sizes
from dancediff.papers.tcdiffpp.footwork_adaptor import (
    FootworkAdaptor,
    NoFootworkAdaptor,
    ground_velocity,
)
from dancediff.papers.tcdiffpp.group_dance_decoder import GroupDanceDecoder

COMPONENTS = ("dancer_positioning", "fusion_projection", "footwork_adaptor", "swap_mode", "ssm")


@dataclass(frozen=True)
class TCDiffPPConfig:
    """Sizes; plain values, so that it can be stored as JSON.

    The defaults are a small model which two CPU cores can train; `paper` has the published sizes.

    >>> TCDiffPPConfig.paper(max_dancers=3).d_model
    512
    """

    d_model: int = 128  # width of a token
    num_heads: int = 4  # of attention
    num_layers: int = 4  # of each decoder
    ff_dim: int = 512  # width inside a feed-forward block
    max_dancers: int = 5  # of one group
    num_frames: int = 150  # of one segment: 5 seconds
    motion_dim: int = 151  # features of a dancer's frame
    music_dim: int = 35  # features of a frame of music
    fusion_hidden: int = 512  # width inside the Fusion Projection
    footwork_hidden: int = 128  # width inside the Footwork Adaptor
    dropout: float = 0.0  # share of values that are set to zero in training
    cond_drop: float = 0.25  # share of windows in training whose music is masked
    num_steps: int = 1000  # noise levels
    without: tuple[str, ...] = ()  # components that Table 4 leaves out, of `COMPONENTS`

    def __post_init__(self):
        """Refuse sizes that no network can have; JSON knows no tuples.

        Raises: ValueError naming the size, its value and what is allowed.
        """
        object.__setattr__(self, "without", tuple(self.without))
        for name in self.without:
            if name not in COMPONENTS:
                raise ValueError(f"without: {name!r} is not one of {', '.join(COMPONENTS)}")
        check_sizes(vars(self))

    @classmethod
    def paper(cls, **changes) -> "TCDiffPPConfig":
        """Sizes of TCDiff++ section 5.1: 8 layers, 8 heads, width 512.

        Feed-forward and Fusion Projection, 1024 wide, dropout and the Footwork Adaptor, 128 wide,
        are the released code's; section 5.1 has "512 in all components".
        """
        sizes = {"d_model": 512, "num_heads": 8, "num_layers": 8, "ff_dim": 1024}
        return cls(**sizes | {"fusion_hidden": 1024, "dropout": 0.1} | changes)


class TCDiffPP(DanceNetwork):
    r"""The whole model: Group Dance Decoder, Footwork Adaptor, normalisers and noise schedule.

    $$\hat x_r = \text{GDD}(x_t, t, M, S), \qquad \hat x = \text{FA}(\hat x_r)$$

    Source: TCDiff++ section 4.  Differs: one model serves 1 to ``max_dancers`` dancers, and one
    pair of normalisers, fitted on the training set, serves every clip.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music and swap -> x_raw, x_hat, both
    (b, n, f, d).  Dancers come in left-to-right order of the first frame.

    >>> import torch
    >>> model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32))
    >>> conditions = Conditions(torch.randn(2, 20, 35), swap=torch.arange(3).expand(2, 3))
    >>> x_raw, x_hat = model(torch.randn(2, 3, 20, 151), torch.tensor([10, 900]), conditions)
    >>> x_hat.shape
    torch.Size([2, 3, 20, 151])
    """

    config: TCDiffPPConfig

    def __init__(self, config: TCDiffPPConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or TCDiffPPConfig()
        super().__init__(c.motion_dim, c.music_dim, c.num_steps)
        self.config = c
        self.decoder = GroupDanceDecoder(c)
        self.footwork_adaptor: nn.Module = FootworkAdaptor(c.footwork_hidden)
        if "footwork_adaptor" in c.without:
            self.footwork_adaptor = NoFootworkAdaptor()

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Guess the clean dance, without and with the Footwork Adaptor."""
        x_raw = self.decoder(x_t, t, conditions)
        return x_raw, self.footwork_adaptor(x_raw, ground_velocity(x_raw))

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The adapted guess alone, (b, n, f, d)."""
        return self(x_t, t, conditions)[1]
