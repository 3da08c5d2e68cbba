r"""Local diffusion: 256 frames of dance, in the style of a genre, with feet that hold the floor.

Read first: notebook 12 · Lodge section 3.4.

Symbols (axes: b batch · f frames · d motion, m music features)
    x_t            noisy motion, normalised                        (b, f, d)
    t              diffusion step                                  (b,)
    M              music features, standardised                    (b, f, m)
    style          the style token, see `dancediff.papers.lodge.style`    (b, d_model)
    x_raw, x_hat   the guess before and after the Foot Refine Block   (b, f, d)
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.beat_phase import NUM_WAVES, beat_waves
from dancediff.extensions.non_local_filter import NonLocalFilter, left_over
from dancediff.extensions.preconditioning import Preconditioning
from dancediff.genre import FINEDANCE, GENRES
from dancediff.motion.representation import Normalizer
from dancediff.music.features import MusicNormalizer
from dancediff.papers.lodge.foot_refine import FootRefine, foot_features, joints_of
from dancediff.papers.lodge.style import StyleToken
from dancediff.papers.lodge.trunk import Trunk, check_shapes


@dataclass
class LocalConfig:
    """Sizes and switches of the second stage; plain values, so that it can be stored as JSON.

    >>> len(LocalConfig().genres), len(LocalConfig.paper().genres)
    (11, 16)
    """

    d_model: int = 128
    num_heads: int = 4
    num_layers: int = 4
    ff_dim: int = 512
    num_frames: int = 256  # n
    motion_dim: int = 139
    music_dim: int = 35
    genres: tuple[str, ...] = GENRES
    style_noise: int = 64
    style_film: bool = True  # ours: the style joins the FiLM condition, too
    foot_refine: bool = True
    beat_waves: bool = False  # ours: see extensions.beat_phase; on in configs
    non_local: bool = False  # ours: see extensions.non_local_filter; on in configs
    dropout: float = 0.0
    cond_drop: float = 0.25
    num_steps: int = 1000
    precondition: bool = True  # ours: see extensions.preconditioning

    def __post_init__(self):
        """JSON knows no tuples."""
        self.genres = tuple(self.genres)
        if len(set(self.genres)) < len(self.genres) or not self.genres:
            raise ValueError(f"genres={self.genres} must hold at least one name, each once")

    @classmethod
    def paper(cls, **changes) -> "LocalConfig":
        """Sizes of Lodge, with FineDance's 16 genres; 60,765,462 weights."""
        sizes = {
            "d_model": 512,
            "num_heads": 8,
            "num_layers": 8,
            "ff_dim": 1024,
            "genres": FINEDANCE,
            "style_noise": 256,
            "style_film": False,
            "dropout": 0.1,
            "precondition": False,
        }
        return cls(**sizes | changes)


class LocalDenoiser(nn.Module):
    r"""The denoiser of the second stage.

    $$x_r = \text{trunk}(x_t, t, M, s), \qquad \hat x_0 = x_r + \text{FRB}(x_r)$$

    Source: Lodge section 3.4: EDGE's network with a style token in the memory, then the Foot Refine
    Block.  Differs: the style may join the FiLM condition (``style_film``); with preconditioning
    the correction of the feet passes through it as well, so that it is as smooth as dance is.
    Without music (``music_mask`` False) the style is still heard, as in the released code.

    Shapes: see the module's symbols; returns x_raw, x_hat, both (b, f, d).
    Raises: ValueError naming the argument whose shape does not fit.

    >>> model = LocalDenoiser(LocalConfig(d_model=16, num_layers=1, ff_dim=32, num_frames=20))
    >>> style = model.style(torch.tensor([0, 3]), torch.randn(2, 64))
    >>> conditions = Conditions(torch.randn(2, 20, 35), style=style)
    >>> x_raw, x_hat = model(torch.randn(2, 20, 139), torch.tensor([10, 900]), conditions)
    >>> x_hat.shape
    torch.Size([2, 20, 139])
    """

    def __init__(self, config: LocalConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        super().__init__()
        self.config = c = config or LocalConfig()
        self.trunk = Trunk(
            c.d_model,
            c.num_heads,
            c.num_layers,
            c.ff_dim,
            motion_dim=c.motion_dim,
            music_dim=c.music_dim,
            music_frames=c.num_frames,
            dropout=c.dropout,
            with_guess=c.precondition,
        )
        self.style = StyleToken(c.d_model, len(c.genres), c.style_noise)
        self.embed_beat = None
        if c.beat_waves:
            self.embed_beat = nn.Linear(NUM_WAVES, c.d_model, bias=False)
        self.non_local = None
        if c.non_local:
            if not c.precondition:
                raise ValueError("non_local=True averages the linear guess; set precondition=True")
            self.non_local = NonLocalFilter(c.d_model, c.motion_dim)
        self.foot_refine = None
        if c.foot_refine:
            self.foot_refine = FootRefine(
                c.d_model,
                num_heads=c.num_heads,
                ff_dim=c.ff_dim,
                motion_dim=c.motion_dim,
                dropout=c.dropout,
            )
        self.precondition = Preconditioning(c.num_frames, c.motion_dim) if c.precondition else None
        one = torch.ones(c.motion_dim)
        self.normalizer = Normalizer(-one, one)
        self.music_normalizer = MusicNormalizer(torch.zeros(c.music_dim), torch.ones(c.music_dim))
        self.register_buffer("abar", cosine_abar(c.num_steps), persistent=False)
        self.register_buffer("frames", torch.arange(c.num_frames), persistent=False)

    @property
    def spread(self) -> Tensor | None:
        """Of each frequency in the training set (k, d), known to a model with preconditioning."""
        return None if self.precondition is None else self.precondition.spread

    def fit_precondition(self, windows, weights=None) -> None:
        """Take the spectrum of clean normalised windows, in pieces (w, f, d).

        See `dancediff.extensions.preconditioning.Preconditioning.fit`; nothing without
        preconditioning.
        """
        if self.precondition is not None:
            self.precondition.fit(windows, weights)

    def denoise(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """The guess with refined feet, (b, f, d)."""
        return self(x_t, t, conditions)[1]

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Guess the clean motion, before and after the feet were looked at."""
        M, style, keep = conditions.music, conditions.style, conditions.music_mask
        self._check(x_t, t, M, style)
        abar, guess, linear = self.abar[t].float(), None, {}
        if self.precondition is not None:
            guess = self.precondition.linear_guess(x_t[:, None], abar)[:, 0]
            noise = self.precondition.noise(x_t[:, None], guess[:, None], abar)[:, 0]
            linear = {"guess": guess, "noise": noise}
        music, steps, cond = self.trunk.conditions(M, t, keep)
        if self.config.style_film:
            cond = cond + style.float()
        memory = [music, steps, style.float()[:, None]]
        waves = self.hear_beats(M, keep)
        h = self.trunk.tokens(x_t, memory, cond, self.frames, waves=waves, **linear)
        x_raw = self._added(self.trunk.read(h), guess, abar)
        if self.non_local is not None:
            one = (guess[:, None], left_over(x_t[:, None], guess[:, None], abar))
            x_raw = x_raw + self.non_local(h.float()[:, None], *one)[:, 0]
        if self.foot_refine is None:
            return x_raw, x_raw
        delta = self.foot_refine(x_raw, self.feet(x_raw), steps, cond)
        return x_raw, self._added(delta, x_raw, abar)

    def linear_guess(self, x_t: Tensor, t: Tensor) -> Tensor:
        """What preconditioning guesses without a network, (b, f, d)."""
        return self.precondition.linear_guess(x_t[:, None], self.abar[t].float())[:, 0]

    def hear_beats(self, M: Tensor, keep: Tensor | None = None) -> Tensor | None:
        """How far each frame is between two beats, embedded, where the config says so.

        Shapes: M (b, f, m) -> (b, f, d_model), zero where there is no music.

        Source: ours; the same as in `dancediff.papers.tcdiffpp.group_dance_decoder`. Not for the
        global
        stage, whose soft primitives are moved to a beat only after they are made.
        """
        if self.embed_beat is None:
            return None
        waves = self.embed_beat(beat_waves(M))
        return waves if keep is None else waves * keep[:, None, None]

    def feet(self, x_raw: Tensor) -> Tensor:
        """`foot_features` of normalised motion (b, f, d), in float32: they are millimetres."""
        with torch.autocast(x_raw.device.type, enabled=False):
            _, _, joints = joints_of(self.normalizer.unnormalize(x_raw.float()))
            return foot_features(joints)

    def _added(self, F: Tensor, to: Tensor | None, abar: Tensor) -> Tensor:
        """Add what a network says to what is there, at the sizes that are due at this noise."""
        if self.precondition is None:
            return F if to is None else to + F
        with torch.autocast(F.device.type, enabled=False):
            return self.precondition(F[:, None], to[:, None], abar)[:, 0]

    def _check(self, x_t: Tensor, t: Tensor, M: Tensor, style: Tensor) -> None:
        c, b = self.config, len(x_t)
        check_shapes(
            x_t=(x_t, (b, c.num_frames, c.motion_dim)),
            t=(t, (b,)),
            M=(M, (b, c.num_frames, c.music_dim)),
            style=(style, (b, c.d_model)),
        )
