r"""Local diffusion: 256 frames of dance, in the style of a genre, with feet that hold the floor.

Read first: notebook 12 · Lodge section 3.4.

Symbols (axes: b batch · f frames · d motion, m music features)
    x_t            noisy motion, normalised                           (b, f, d)
    t              noise level                                        (b,)
    M              music features, standardised                       (b, f, m)
    style          the style token, see `dancediff.papers.lodge.style`   (b, d_model)
    x_raw, x_hat   the guess before and after the Foot Refine Block   (b, f, d)
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.genre import FINEDANCE
from dancediff.motion.representation import LODGE, joints_of
from dancediff.nn.attention import full_precision
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.decoder import DanceDecoder, check_shapes
from dancediff.papers.lodge.foot_refine import FootRefine, NoFootRefine, foot_features
from dancediff.papers.lodge.style import StyleToken


@dataclass(frozen=True)
class LocalConfig:
    """Sizes of the second stage; plain values, so that it can be stored as JSON.

    >>> len(LocalConfig().genres)
    16
    """

    d_model: int = 512  # width of a token
    num_heads: int = 8  # of attention
    num_layers: int = 8  # of the decoder
    ff_dim: int = 1024  # width inside a feed-forward block
    num_frames: int = 256  # n, of one local segment
    motion_dim: int = 139  # features of a frame of motion
    music_dim: int = 35  # features of a frame of music
    genres: tuple[str, ...] = FINEDANCE  # that it can be asked for
    style_noise: int = 256  # random numbers of which a style token is made
    foot_refine: bool = True  # without it: Table 5
    dropout: float = 0.1  # share of values that are set to zero in training
    cond_drop: float = 0.25  # share of windows in training whose music is masked
    num_steps: int = 1000  # noise levels

    def __post_init__(self):
        """JSON knows no tuples."""
        object.__setattr__(self, "genres", tuple(self.genres))
        if len(set(self.genres)) < len(self.genres) or not self.genres:
            raise ValueError(f"genres={self.genres} must hold at least one name, each once")


class LocalDenoiser(DanceNetwork):
    r"""The denoiser of the second stage.

    $$x_r = \text{decoder}(x_t, t, M, s), \qquad \hat x_0 = x_r + \text{FRB}(x_r)$$

    Source: Lodge section 3.4: EDGE's network with a style token in the memory, then the Foot Refine
    Block; 60,765,462 weights.  Without music the style is still there, as in the released code.

    Shapes: x_t (b, f, d), t (b,), conditions with music (b, f, m) and style (b, d_model)
    -> x_raw, x_hat, both (b, f, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "num_frames": 20}
    >>> model = LocalDenoiser(LocalConfig(**sizes))
    >>> style = model.style(torch.tensor([0, 3]), torch.randn(2, 256))
    >>> conditions = Conditions(torch.randn(2, 20, 35), style=style)
    >>> x_raw, x_hat = model(torch.randn(2, 20, 139), torch.tensor([10, 900]), conditions)
    >>> x_hat.shape
    torch.Size([2, 20, 139])
    """

    config: LocalConfig
    frames: Tensor

    def __init__(self, config: LocalConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or LocalConfig()
        super().__init__(c.motion_dim, c.music_dim, c.num_steps)
        self.config = c
        self.decoder = DanceDecoder.of(c, c.num_frames)
        self.style = StyleToken(c.d_model, len(c.genres), c.style_noise)
        block = FootRefine if c.foot_refine else NoFootRefine
        self.foot_refine = block(
            c.d_model,
            num_heads=c.num_heads,
            ff_dim=c.ff_dim,
            motion_dim=c.motion_dim,
            dropout=c.dropout,
        )
        self.register_buffer("frames", torch.arange(c.num_frames), persistent=False)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Guess the clean motion, before and after its feet are refined."""
        self.check(x_t, t, conditions)
        music, steps, cond = self.decoder.condition(t, conditions)
        assert conditions.style is not None  # `check` has looked
        memory = [music, steps, full_precision(conditions.style)[:, None]]
        h = self.decoder(self.decoder.embed(x_t), memory, cond, self.frames)
        x_raw = self.decoder.read(h)
        return x_raw, x_raw + self.foot_refine(x_raw, self.feet(x_raw), steps, cond)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess with refined feet, (b, f, d)."""
        return self(x_t, t, conditions)[1]

    def feet(self, x_raw: Tensor) -> Tensor:
        """`foot_features` of normalised motion (b, f, d), in float32: they are millimetres."""
        with torch.autocast(x_raw.device.type, enabled=False):
            return foot_features(
                joints_of(self.normalizer.unnormalize(full_precision(x_raw)), LODGE)
            )

    def check(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> None:
        """Refuse shapes that do not fit."""
        c, b = self.config, len(x_t)
        check_shapes(
            x_t=(x_t, (b, c.num_frames, c.motion_dim)),
            t=(t, (b,)),
            music=(conditions.music, (b, c.num_frames, c.music_dim)),
            style=(conditions.style, (b, c.d_model)),
        )
