r"""Global diffusion: from a long stretch of music to its characteristic dance primitives.

Read first: notebook 11 · Lodge section 3.3.

Symbols (axes: b batch · p primitives · f frames of all primitives · d motion, m music features)
    N, n     frames of a global and of a local segment: 1024 and 256
    x_t      noisy primitives, one after the other, normalised    (b, f, d)   f = 13 x 8 = 104
    M        music of the global segment, standardised            (b, N, m)
    style    the style token, see `dancediff.papers.lodge.style`         (b, d_model)
    x0_hat   the guess                                            (b, f, d)
    frames   where in the segment each token is danced            (f,)

Order of the primitives: h0 s s h1 s s h2 s s h3 s s h4. A hard one (h) stands on each border of
local segments, two soft ones (s) in each.
"""

from dataclasses import dataclass

import torch
from einops import rearrange
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.preconditioning import Preconditioning
from dancediff.genre import GENRES
from dancediff.motion.representation import Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.papers.lodge.style import StyleToken
from dancediff.papers.lodge.trunk import Trunk, check_shapes

VARIANTS = ("continuous", "discrete")


@dataclass
class GlobalConfig:
    """Sizes and switches of the first stage; plain values, so that it can be stored as JSON.

    >>> GlobalConfig().num_primitives, GlobalConfig().num_frames
    (13, 104)
    >>> GlobalConfig(music_frames=512).num_frames, GlobalConfig(variant="discrete").num_frames
    (56, 256)
    """

    d_model: int = 128
    num_heads: int = 4
    num_layers: int = 3
    ff_dim: int = 512
    music_frames: int = 1024  # N
    local_frames: int = 256  # n
    primitive_frames: int = 8
    variant: str = "continuous"  # or "discrete": every fourth frame of the segment (Table 6)
    every: int = 4
    pool: int = 1  # frames of music that share a token
    genres: tuple[str, ...] = GENRES  # none: the music alone decides
    style_noise: int = 64
    style_film: bool = True  # ours: the style joins the FiLM condition, too
    motion_dim: int = 139
    music_dim: int = 35
    dropout: float = 0.0
    cond_drop: float = 0.25
    num_steps: int = 1000
    precondition: bool = True  # ours: see extensions.preconditioning

    def __post_init__(self):
        """Catch sizes that do not go together; JSON knows no tuples."""
        self.genres = tuple(self.genres)
        if self.variant not in VARIANTS:
            raise ValueError(f"variant={self.variant!r} is not one of 'continuous', 'discrete'")
        if self.music_frames % self.local_frames:
            raise ValueError(
                f"local_frames={self.local_frames} must divide music_frames={self.music_frames}"
            )

    @classmethod
    def paper(cls, **changes) -> "GlobalConfig":
        """Sizes of Lodge: EDGE's 8 layers, 8 heads, width 512; 47,459,979 weights.

        >>> GlobalConfig.paper().num_layers
        8
        """
        sizes = {
            "d_model": 512,
            "num_heads": 8,
            "num_layers": 8,
            "ff_dim": 1024,
            "genres": (),
            "dropout": 0.1,
            "precondition": False,
        }
        return cls(**sizes | changes)

    @property
    def num_primitives(self) -> int:
        """Hard and soft ones together."""
        return 3 * (self.music_frames // self.local_frames) + 1

    @property
    def clips(self) -> int:
        """Stretches of the output in which one frame follows the other."""
        return self.num_primitives if self.variant == "continuous" else 1

    @property
    def num_frames(self) -> int:
        """Length of the output."""
        if self.variant == "discrete":
            return self.music_frames // self.every
        return self.num_primitives * self.primitive_frames


def token_frames(config: GlobalConfig) -> Tensor:
    """The frame of the segment that each token stands for, as far as the network is told.

    Hard primitives sit on the borders, where they will be used. A soft one is danced on some beat
    of its half of a local segment: it is told the middle of that half.

    Shapes: -> (f,) float.

    >>> token_frames(GlobalConfig()).reshape(13, 8)[:4, 0].tolist()
    [0.0, 60.0, 188.0, 252.0]
    >>> token_frames(GlobalConfig())[-1].item()
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


class GlobalDenoiser(nn.Module):
    r"""The denoiser of the first stage: $\hat x_0 = f_\theta(x_t, t, M)$.

    Source: Lodge section 3.3: EDGE's network, whose output is 13 primitives of 8 frames.
    Differs: the tokens of a primitive know which frames of the song they stand for (in the released
    code token 103 sits beside the music of frame 103, though it is danced at 1023); the paper's
    downsampling of the music, which the released code leaves out, is ``pool``; a style token says
    the genre, which the released code takes and ignores, so that the primitives of a salsa could
    not be those of a salsa; preconditioning (ours) takes each primitive for itself, because its
    neighbours are seconds away.

    Shapes: x_t (b, f, d), t (b,), conditions with music (b, N, m) and, unless the config has no
    genres, style -> (b, f, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> config = GlobalConfig(d_model=16, num_layers=1, ff_dim=32, music_frames=64, local_frames=32)
    >>> model = GlobalDenoiser(config)
    >>> style = model.style(torch.tensor([0, 3]), torch.randn(2, 64))
    >>> conditions = Conditions(torch.randn(2, 64, 35), style=style)
    >>> model(torch.randn(2, 56, 139), torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 56, 139])
    """

    def __init__(self, config: GlobalConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        super().__init__()
        self.config = c = config or GlobalConfig()
        self.trunk = Trunk(
            c.d_model,
            c.num_heads,
            c.num_layers,
            c.ff_dim,
            motion_dim=c.motion_dim,
            music_dim=c.music_dim,
            music_frames=c.music_frames,
            pool=c.pool,
            dropout=c.dropout,
            with_guess=c.precondition,
        )
        self.style = None
        if c.genres:
            self.style = StyleToken(c.d_model, len(c.genres), c.style_noise)
        self.precondition = None
        if c.precondition:
            self.precondition = Preconditioning(c.num_frames // c.clips, c.motion_dim)
        one = torch.ones(c.motion_dim)
        self.normalizer = Normalizer(-one, one)
        self.music_normalizer = MusicNormalizer(torch.zeros(c.music_dim), torch.ones(c.music_dim))
        self.register_buffer("abar", cosine_abar(c.num_steps), persistent=False)
        self.register_buffer("frames", token_frames(c), persistent=False)

    @property
    def spread(self) -> Tensor | None:
        """Of each frequency of a primitive in the training set (k, d), with preconditioning."""
        return None if self.precondition is None else self.precondition.spread

    def clips(self, x: Tensor) -> Tensor:
        """The primitives apart: (b, f, d) -> (b, p, 8, d).

        >>> GlobalDenoiser(GlobalConfig(d_model=16)).clips(torch.zeros(2, 104, 139)).shape
        torch.Size([2, 13, 8, 139])
        """
        return rearrange(x, "b (p f) d -> b p f d", p=self.config.clips)

    def fit_precondition(self, windows, weights=None) -> None:
        """Take the spectrum of clean normalised primitives, in pieces (w, f, d).

        See `dancediff.extensions.preconditioning.Preconditioning.fit`; nothing without
        preconditioning.
        """
        if self.precondition is not None:
            self.precondition.fit((self.clips(x).flatten(0, 1) for x in windows), weights)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess, (b, f, d)."""
        return self(x_t, t, conditions)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean primitives."""
        M, style = conditions.music, conditions.style
        self._check(x_t, t, M, style)
        music, steps, cond = self.trunk.conditions(M, t, conditions.music_mask)
        memory = [music, steps]
        if style is not None:
            memory.append(style.float()[:, None])
            cond = cond + style.float() if self.config.style_film else cond
        if self.precondition is None:
            return self.trunk(x_t, memory, cond, self.frames)
        abar = self.abar[t].float()
        guess = self.precondition.linear_guess(self.clips(x_t), abar)
        noise = self.precondition.noise(self.clips(x_t), guess, abar)
        linear = {"guess": guess.flatten(1, 2), "noise": noise.flatten(1, 2)}
        F = self.trunk(x_t, memory, cond, self.frames, **linear)
        return self.precondition(self.clips(F), guess, abar).flatten(1, 2)

    def linear_guess(self, x_t: Tensor, t: Tensor) -> Tensor:
        """What preconditioning guesses without a network, (b, f, d)."""
        abar = self.abar[t].float()
        return self.precondition.linear_guess(self.clips(x_t), abar).flatten(1, 2)

    def _check(self, x_t: Tensor, t: Tensor, M: Tensor, style: Tensor | None) -> None:
        c, b = self.config, len(x_t)
        check_shapes(
            x_t=(x_t, (b, c.num_frames, c.motion_dim)),
            t=(t, (b,)),
            M=(M, (b, c.music_frames, c.music_dim)),
            style=(style, None if self.style is None else (b, c.d_model)),
        )
