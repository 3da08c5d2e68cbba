r"""Global diffusion: from a long stretch of music to its characteristic dance primitives.

Read first: notebook 11 · Lodge section 3.3.

Symbols (axes: b batch · p primitives · f frames of all primitives · d motion, m music features)
    N, n     frames of a global and of a local segment: 1024 and 256
    x_t      noisy primitives, one after the other, normalised    (b, f, d)   f = 13 x 8 = 104
    M        music of the global segment, standardised            (b, N, m)
    x0_hat   the guess                                            (b, f, d)
    frames   where in the segment each token is danced            (f,)

Order of the primitives: h0 s s h1 s s h2 s s h3 s s h4. A hard one (h) stands on each border of
local segments, two soft ones (s) in each.
"""

from dataclasses import dataclass

import torch
from einops import rearrange
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.nn.dance_network import DanceNetwork
from dancediff.nn.decoder import DanceDecoder, check_shapes
from dancediff.papers.lodge.primitives import Layout
from dancediff.papers.lodge.style import StyleToken

VARIANTS = ("continuous", "discrete")


@dataclass(frozen=True)
class GlobalConfig:
    """Sizes of the first stage; plain values, so that it can be stored as JSON.

    >>> GlobalConfig().layout.num_primitives, GlobalConfig().num_frames
    (13, 104)
    >>> GlobalConfig(music_frames=512).num_frames, GlobalConfig(variant="discrete").num_frames
    (56, 256)
    """

    d_model: int = 512  # width of a token
    num_heads: int = 8  # of attention
    num_layers: int = 8  # of the decoder
    ff_dim: int = 1024  # width inside a feed-forward block
    music_frames: int = 1024  # N, of one global segment
    local_frames: int = 256  # n, of one local segment
    primitive_frames: int = 8  # of one primitive
    variant: str = "continuous"  # or "discrete": every fourth frame of the segment (Table 6)
    every: int = 4  # frames from one to the next, where "discrete"
    pool: int = 1  # frames of music that share a token
    motion_dim: int = 139  # features of a frame of motion
    music_dim: int = 35  # features of a frame of music
    dropout: float = 0.1  # share of values that are set to zero in training
    cond_drop: float = 0.25  # share of windows in training whose music is masked
    num_steps: int = 1000  # noise levels

    def __post_init__(self):
        """Catch sizes that do not go together."""
        if self.variant not in VARIANTS:
            raise ValueError(f"variant={self.variant!r} is not one of 'continuous', 'discrete'")
        if self.music_frames % self.local_frames:
            raise ValueError(
                f"local_frames={self.local_frames} must divide music_frames={self.music_frames}"
            )
        if self.variant == "discrete" and self.music_frames % self.every:
            raise ValueError(f"every={self.every} must divide music_frames={self.music_frames}")

    @property
    def layout(self) -> Layout:
        """The segments and primitives that the stage is made for."""
        stride = self.every if self.variant == "discrete" else 1
        return Layout(self.music_frames, self.local_frames, self.primitive_frames, stride)

    @property
    def clips(self) -> int:
        """Stretches of the output in which one frame follows the other."""
        return self.layout.num_primitives if self.variant == "continuous" else 1

    @property
    def num_frames(self) -> int:
        """Length of the output."""
        if self.variant == "discrete":
            return self.music_frames // self.every
        return self.layout.num_frames


def global_token_frames(config: GlobalConfig) -> Tensor:
    """The frame of the segment that each token stands for, an input of the network.

    Hard primitives sit on the borders, where they will be used; a segment's first and last stand
    4 frames inwards, as they were learned. A soft one is danced on some beat
    of its half of a local segment: its frame is the middle of that half.

    Shapes: -> (f,) float.

    >>> global_token_frames(GlobalConfig()).reshape(13, 8)[:4, 0].tolist()
    [0.0, 60.0, 188.0, 252.0]
    >>> global_token_frames(GlobalConfig())[-1].item()
    1023.0
    """
    c = config
    if c.variant == "discrete":
        return c.every * torch.arange(c.num_frames).float()
    quarters = 4 * (c.music_frames // c.local_frames)
    middles = torch.tensor([k for k in range(quarters + 1) if k % 4 != 2])  # h s . s h s . s h
    starts = middles * (c.local_frames // 4) - c.primitive_frames // 2
    starts = starts.clamp(0, c.music_frames - c.primitive_frames)
    return (starts[:, None] + torch.arange(c.primitive_frames)).flatten().float()


class GlobalDenoiser(DanceNetwork):
    r"""The denoiser of the first stage: $\hat x_0 = f_\theta(x_t, t, M)$.

    Source: Lodge section 3.3: EDGE's network, whose output is 13 primitives of 8 frames; 47,459,979
    weights.  Differs: the tokens of a primitive know which frames of the song they stand for (in
    the released code token 103 sits beside the music of frame 103, though it is danced at 1023);
    the paper's downsampling of the music, which the released code leaves out, is ``pool``.

    Shapes: x_t (b, f, d), t (b,), conditions with music (b, N, m) -> (b, f, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
    >>> model = GlobalDenoiser(GlobalConfig(**sizes, music_frames=64, local_frames=64))
    >>> x_t, conditions = torch.randn(2, 32, 139), Conditions(torch.randn(2, 64, 35))
    >>> model(x_t, torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 32, 139])
    """

    config: GlobalConfig
    frames: Tensor

    def __init__(self, config: GlobalConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        c = config or GlobalConfig()
        super().__init__(c.motion_dim, c.music_dim, c.num_steps)
        self.config = c
        self.decoder = DanceDecoder.of(c, c.music_frames, c.pool)
        self.style: StyleToken | None = None  # this stage has no genre
        self.register_buffer("frames", global_token_frames(c), persistent=False)

    def clips(self, x: Tensor) -> Tensor:
        """The primitives apart: (b, f, d) -> (b, p, 8, d)."""
        return rearrange(x, "b (p f) d -> b p f d", p=self.config.clips)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean primitives."""
        self.check(x_t, t, conditions)
        music, steps, cond = self.decoder.condition(t, conditions)
        h = self.decoder(self.decoder.embed(x_t), [music, steps], cond, self.frames)
        return self.decoder.read(h)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess, (b, f, d)."""
        return self(x_t, t, conditions)

    def check(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> None:
        """Refuse shapes that do not fit."""
        c, b = self.config, len(x_t)
        check_shapes(
            x_t=(x_t, (b, len(self.frames), c.motion_dim)),
            t=(t, (b,)),
            music=(conditions.music, (b, c.music_frames, c.music_dim)),
            style=(conditions.style, None if self.style is None else (b, c.d_model)),
        )
