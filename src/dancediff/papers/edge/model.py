r"""EDGE: the transformer that TCDiff++ and Lodge build on; it knows one dancer and her music.

Read first: notebook 05 · Tseng et al. 2023 (EDGE) section 3.

Symbols (axes: b batch · n dancers · f frames · d motion, m music features)
    x_t    noisy motion, normalised            (b, n, f, d)
    x_hat  the guess                           (b, n, f, d)
    home   where a dancer is, on the average   (n, 1, 3) metres, height left out

A group is danced by n copies who neither see nor hear of each other: that is what makes it the
baseline of a group model.
"""

from dataclasses import asdict, dataclass

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.motion.representation import TCDIFFPP, Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.papers.tcdiffpp.group_dance_decoder import GroupDanceDecoder
from dancediff.papers.tcdiffpp.model import TCDiffPPConfig

SPACING = 1.2  # metres between the start slots, about as in the training data


@dataclass
class EDGEConfig:
    """Sizes; plain values, so that it can be stored as JSON.

    The defaults are as small as those of `TCDiffPPConfig`; `paper` has the published sizes.

    >>> EDGEConfig.paper().d_model
    512
    """

    d_model: int = 128
    num_heads: int = 4
    num_layers: int = 4
    ff_dim: int = 512
    max_dancers: int = 10  # who find a place on the stage; the network knows one
    num_frames: int = 150  # 5 seconds
    motion_dim: int = 151
    music_dim: int = 35
    dropout: float = 0.0
    cond_drop: float = 0.25
    num_steps: int = 1000
    beat_waves: bool = False  # ours: see extensions.beat_phase; on in configs
    non_local: bool = False  # ours: see extensions.non_local_filter; on in configs
    precondition: bool = True  # ours: see extensions.preconditioning

    @classmethod
    def paper(cls, **changes) -> "EDGEConfig":
        """Sizes of EDGE: 8 layers, 8 heads, width 512; 47,024,791 weights with 35-d music."""
        sizes = {
            "d_model": 512,
            "num_heads": 8,
            "num_layers": 8,
            "ff_dim": 1024,
            "dropout": 0.1,
            "precondition": False,
        }
        return cls(**sizes | changes)


class EDGE(nn.Module):
    r"""A transformer decoder for one dancer: self-attention, cross-attention, feed-forward, FiLM.

    $$\hat x = \text{decoder}(x_t, t, M)$$

    This is the Group Dance Decoder with all that TCDiff++ added taken out, for a group of one; the
    paper's sizes have exactly the published number of weights.

    Source: EDGE section 3.  Differs: positions are rotated after the projection, head by head, as
    everywhere here; music is the 35-d features instead of Jukebox's 4800; the contact loss counts
    contacts above 0.5 instead of 0.95, and joints are in metres.  Trained with TCDiff++'s loop,
    whose weights for EDGE's four losses are EDGE's; L_D is zero for one dancer.

    Shapes: x_t (b, n, f, d), t (b,), conditions with music -> the guess twice, both (b, n, f, d):
    what `TCDiffPP` calls raw and adapted.

    >>> model = EDGE(EDGEConfig(d_model=16, num_layers=1, ff_dim=32))
    >>> x_t, conditions = torch.randn(2, 3, 20, 151), Conditions(torch.randn(2, 20, 35))
    >>> model(x_t, torch.tensor([10, 900]), conditions)[1].shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(self, config: EDGEConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        super().__init__()
        self.config = config = config or EDGEConfig()
        self.decoder = GroupDanceDecoder(without_group(config))
        one = torch.ones(config.motion_dim)
        self.normalizer = Normalizer(-one, one)
        self.music_normalizer = MusicNormalizer(
            torch.zeros(config.music_dim), torch.ones(config.music_dim)
        )
        self.register_buffer("abar", cosine_abar(config.num_steps), persistent=False)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Guess the clean dance; every dancer is a sample of its own."""
        x_hat = self.decoder(*self._alone(x_t, t, conditions)).reshape(x_t.shape)
        return x_hat, x_hat

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess, (b, n, f, d)."""
        return self(x_t, t, conditions)[1]

    def linear_guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What a model with preconditioning guesses without its network, (b, n, f, d)."""
        return self.decoder.linear_guess(*self._alone(x_t, t, conditions)).reshape(x_t.shape)

    def _alone(self, x_t: Tensor, t: Tensor, conditions: Conditions):
        n = x_t.shape[1]
        nobody_swaps = torch.zeros(len(x_t) * n, 1, dtype=torch.long, device=x_t.device)
        M, mask = (
            None if a is None else a.repeat_interleave(n, 0)
            for a in (conditions.music, conditions.music_mask)
        )
        conditions = Conditions(M, nobody_swaps, music_mask=mask)
        return x_t.flatten(0, 1)[:, None], t.repeat_interleave(n, 0), conditions


def without_group(config: EDGEConfig) -> TCDiffPPConfig:
    """The configuration of a Group Dance Decoder that is EDGE.

    >>> without_group(EDGEConfig()).max_dancers
    1
    """
    off = dict.fromkeys(("dpe", "fp", "fa", "swap_mode", "foot_cues"), False)
    return TCDiffPPConfig(**asdict(config) | {"max_dancers": 1, "ssm": "none"} | off)


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
