r"""TCDiff++: a song in, a group dance out.

Read first: notebook 10 · TCDiff++ sections 3 and 4.

Symbols (axes: b batch · n dancers · f frames · d motion, m music features)
    x_raw, x_hat   the guess before and after the Footwork Adaptor   (b, n, f, d)
    abar           $\bar\alpha_t$, signal kept after t steps         (T,)
"""

from dataclasses import dataclass, fields
from functools import partial

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.foot_cues import NUM_MOVING, foot_cues
from dancediff.motion.representation import Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.papers.tcdiffpp.footwork_adaptor import FootworkAdaptor
from dancediff.papers.tcdiffpp.group_dance_decoder import GroupDanceDecoder

LARGEST, MOST_LAYERS = 8192, 64  # a size beyond is a slip; such a network is never done building


@dataclass
class TCDiffPPConfig:
    """Sizes and switches; plain values, so that it can be stored as JSON.

    The defaults are a small model which two CPU cores can train; `paper` has the published sizes.

    >>> TCDiffPPConfig.paper(max_dancers=3).d_model
    512
    """

    d_model: int = 128
    num_heads: int = 4
    num_layers: int = 4
    ff_dim: int = 512
    max_dancers: int = 5
    num_frames: int = 150  # 5 seconds
    motion_dim: int = 151
    music_dim: int = 35
    fusion_hidden: int = 512
    footwork_hidden: int = 128
    ssm: str = "ssd"  # or "mamba" (the paper's), or "none"
    d_state: int = 16
    expand: int = 2
    head_dim: int = 64  # only for "ssd"
    bidirectional: bool = False
    layer: str = "paper"  # or "released": see nn.decoder.DecoderLayer
    dropout: float = 0.0
    cond_drop: float = 0.25
    num_steps: int = 1000
    dpe: bool = True
    fp: bool = True
    fa: bool = True
    swap_mode: bool = True
    fusion_residual: bool = True  # ours: see FusionProjection
    footwork_residual: bool = True  # ours: see FootworkAdaptor
    foot_cues: bool = False  # ours: see foot_cues; on in configs
    beat_waves: bool = False  # ours: see extensions.beat_phase; on in configs
    non_local: bool = False  # ours: see extensions.non_local_filter; on in configs
    formation_prior: bool = False  # ours: see formation_prior; on in configs
    precondition: bool = True  # ours: see extensions.preconditioning

    def __post_init__(self):
        """Refuse sizes that no network can have.

        Raises: ValueError naming the size, its value and what is allowed.
        """
        for one in fields(self):
            value = getattr(self, one.name)
            most = MOST_LAYERS if one.name == "num_layers" else LARGEST
            if type(one.default) is int and not 1 <= value <= most:
                raise ValueError(f"{one.name}={value} must lie in 1 ... {most}")

    @classmethod
    def paper(cls, **changes) -> "TCDiffPPConfig":
        """Sizes of TCDiff++ section 5.1: 8 layers, 8 heads, width 512, Mamba."""
        sizes = {
            "d_model": 512,
            "num_heads": 8,
            "num_layers": 8,
            "ff_dim": 1024,
            "fusion_hidden": 1024,
            "ssm": "mamba",
            "dropout": 0.1,
            "fusion_residual": False,
            "footwork_residual": False,
            "foot_cues": False,
            "beat_waves": False,
            "non_local": False,
            "formation_prior": False,
            "precondition": False,
        }
        return cls(**sizes | changes)


class TCDiffPP(nn.Module):
    r"""The whole model: Group Dance Decoder, Footwork Adaptor, normalisers and noise schedule.

    $$\hat x_r = \text{GDD}(x_t, t, M, S), \qquad \hat x = \text{FA}(\hat x_r)$$

    Source: TCDiff++ section 4.  Differs: one model serves 1 to ``max_dancers`` dancers, and one
    pair of normalisers, fitted on the training set, serves every clip.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music and swap -> x_raw, x_hat, both
    (b, n, f, d).  Dancers come in left-to-right order of the first frame.

    >>> model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32))
    >>> conditions = Conditions(torch.randn(2, 20, 35), swap=torch.arange(3).expand(2, 3))
    >>> x_raw, x_hat = model(torch.randn(2, 3, 20, 151), torch.tensor([10, 900]), conditions)
    >>> x_hat.shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(self, config: TCDiffPPConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        super().__init__()
        self.config = config = config or TCDiffPPConfig()
        self.decoder = GroupDanceDecoder(config)
        self.footwork = (
            FootworkAdaptor(
                config.footwork_hidden,
                residual=config.footwork_residual,
                cues=NUM_MOVING if config.foot_cues else 0,
            )
            if config.fa
            else None
        )
        one = torch.ones(config.motion_dim)
        self.normalizer = Normalizer(-one, one)
        self.music_normalizer = MusicNormalizer(
            torch.zeros(config.music_dim), torch.ones(config.music_dim)
        )
        self.register_buffer("abar", cosine_abar(config.num_steps), persistent=False)

    @property
    def spread(self) -> Tensor | None:
        """Of each frequency in the training set (k, d), known to a model with preconditioning."""
        return None if self.decoder.precondition is None else self.decoder.precondition.spread

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Guess the clean dance, without and with the Footwork Adaptor."""
        cues = partial(foot_cues, normalizer=self.normalizer) if self.config.foot_cues else None
        x_raw = self.decoder(x_t, t, conditions, foot_cues=cues)
        if self.footwork is None:
            return x_raw, x_raw
        x_hat = self.footwork(x_raw, None if cues is None else cues(x_raw)[..., -NUM_MOVING:])
        if (precondition := self.decoder.precondition) is not None:
            group = self.decoder.group_modes(conditions.swap, x_t.shape[2])
            x_hat = precondition(x_hat - x_raw, x_raw, self.abar[t].float(), group)
        return x_raw, x_hat

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The adapted guess alone, (b, n, f, d)."""
        return self(x_t, t, conditions)[1]

    def linear_guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What a model with preconditioning guesses without its network, (b, n, f, d)."""
        return self.decoder.linear_guess(x_t, t, conditions)
