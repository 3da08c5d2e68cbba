"""Networks with extensions: the plain one of a paper, step by step, with parts in between.

Read first: `dancediff.papers.tcdiffpp.model` and `dancediff.papers.edge.model`, the networks as the
papers have them · `dancediff.extensions.parts`.
"""

from collections.abc import Callable, Sequence
from typing import Any

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.aligned_attention import align_attention
from dancediff.extensions.beat_phase import BeatPhase
from dancediff.extensions.energy_condition import EnergyCondition
from dancediff.extensions.foot_cues import NUM_MOVING, FootCues
from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.frame_tokens import FrameTokens, pool_music
from dancediff.extensions.genre_condition import GenreCondition
from dancediff.extensions.genre_prior import GenrePrior
from dancediff.extensions.non_local_filter import NonLocalFilter
from dancediff.extensions.parts import Part, Parts, Pass
from dancediff.extensions.preconditioning import LinearStart, preconditioning_of
from dancediff.extensions.residuals import FootworkResidual, FusionResidual
from dancediff.extensions.ssd import SSDBlock
from dancediff.genre import GENRES
from dancediff.nn.conditioning import MusicConditioning
from dancediff.nn.dance_network import DanceNetwork
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.gcd.model import GCD, GCDConfig
from dancediff.papers.tcdiff.model import TCDiff, TCDiffConfig
from dancediff.papers.tcdiff.trajectory_diffusion import on_path
from dancediff.papers.tcdiffpp.footwork_adaptor import FootworkAdaptor, ground_velocity
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig


class Extended(DanceNetwork):
    """What extended models share: they begin a pass, and can stop after the linear guess."""

    parts: Parts

    def prepare(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Pass:
        """Begin a pass through the network."""
        run = Pass(x_t, self.abar[t].float(), conditions, self.normalizer)
        return self.parts.prepare(run)

    @property
    def std(self) -> Tensor:
        """Standard deviation of each frequency in the training set (k, d)."""
        preconditioning = preconditioning_of(self)
        assert preconditioning is not None
        return preconditioning.std

    def linear_guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What preconditioning guesses without the network, like x_t."""
        return self.prepare(x_t, t, conditions).guess


class ExtendedTCDiffPP(Extended, TCDiffPP):
    """TCDiff++ with extensions; shapes as `TCDiffPP`.

    >>> import torch
    >>> config = TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32)
    >>> model = ExtendedTCDiffPP(config, ["preconditioning", "foot_cues"])
    >>> conditions = Conditions(torch.randn(2, 20, 35), swap=torch.arange(3).expand(2, 3))
    >>> model.denoise(torch.randn(2, 3, 20, 151), torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(
        self, config: TCDiffPPConfig, extensions: Sequence[str], genres: Sequence[str] = GENRES
    ):
        super().__init__(config)
        c, decoder = config, self.decoder
        self.parts = parts_of(c, extensions, genres=genres)
        self.frame_tokens = frame_tokens(decoder, c, extensions)
        if "aligned_attention" in extensions:
            align_attention(self)
        if "ssd" in extensions and "ssm" not in c.without:
            for layer in decoder.sequence_decoder.layers:
                layer.ssm = SSDBlock(c.d_model)
        if "fusion_residual" in extensions and "fusion_projection" not in c.without:
            decoder.fusion_projection = FusionResidual(decoder.fusion_projection)
        adaptor = self.footwork_adaptor
        if isinstance(adaptor, FootworkAdaptor):  # else the config leaves it out
            if "foot_cues" in extensions:
                adaptor = FootworkAdaptor(c.footwork_hidden, d_cond=2 + NUM_MOVING)
            residual = "footwork_residual" in extensions
            self.footwork_adaptor = FootworkResidual(adaptor) if residual else adaptor

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Guess the clean dance, without and with the Footwork Adaptor."""
        decoder, parts = self.decoder, self.parts
        decoder.check(x_t, t, conditions)
        run = self.prepare(x_t, t, conditions)
        h = parts.embed(decoder.embed(x_t), run)

        def layers(h: Tensor) -> Tensor:
            memory, cond = decoder.memory(t, conditions)
            return decoder.sequence_decoder(h, memory, parts.film(cond, run))

        if self.frame_tokens is None:
            h = layers(parts.tokens(decoder.place(h), run))
        else:
            h = parts.tokens(h, run)
            low = decoder.place(self.frame_tokens.pool(h))  # (b, n, f / 3, d_model)
            h = self.frame_tokens.unpool(layers(low), h)
        x_raw = parts.read(decoder.read(h), h, run)
        v = parts.velocity(ground_velocity(x_raw), x_raw, run)
        return x_raw, parts.adapt(self.footwork_adaptor(x_raw, v), x_raw, run)


class ExtendedEDGE(Extended, EDGE):
    """EDGE with extensions; shapes as `EDGE`.

    >>> import torch
    >>> model = ExtendedEDGE(EDGEConfig(d_model=16, num_layers=1, ff_dim=32), ["preconditioning"])
    >>> x_t, conditions = torch.randn(2, 3, 20, 151), Conditions(torch.randn(2, 20, 35))
    >>> model(x_t, torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(
        self, config: EDGEConfig, extensions: Sequence[str], genres: Sequence[str] = GENRES
    ):
        super().__init__(config)
        self.parts = parts_of(config, extensions, genres=genres)
        self.frame_tokens = frame_tokens(self.decoder, config, extensions)
        if "aligned_attention" in extensions:
            align_attention(self)

    def guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean motion of single dancers, (b, f, d)."""
        decoder, parts, run = self.decoder, self.parts, super().prepare(x_t, t, conditions)
        h = parts.tokens(parts.embed(decoder.embed(x_t), run), run)

        def layers(h: Tensor) -> Tensor:
            music, steps, cond = decoder.condition(t, conditions)
            frames = torch.arange(h.shape[1], device=h.device)
            return decoder(h, [music, steps], parts.film(cond, run), frames)

        if self.frame_tokens is None:
            h = layers(h)
        else:
            low = self.frame_tokens.pool(h)  # (b, f / 3, d_model)
            h = self.frame_tokens.unpool(layers(low), h)
        return parts.read(decoder.read(h), h, run)

    def linear_guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What preconditioning guesses without the network, (b, n, f, d)."""
        return super().linear_guess(*self.alone(x_t, t, conditions)).reshape(x_t.shape)


class ExtendedGCD(Extended, GCD):
    """GCD with extensions; shapes as `GCD`.

    >>> import torch
    >>> model = ExtendedGCD(GCDConfig(d_model=16, num_layers=1, ff_dim=32), ["preconditioning"])
    >>> x_t, conditions = torch.randn(2, 3, 20, 151), Conditions(torch.randn(2, 20, 35))
    >>> model(x_t, torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(
        self, config: GCDConfig, extensions: Sequence[str], genres: Sequence[str] = GENRES
    ):
        super().__init__(config)
        self.parts = parts_of(config, extensions, genres=genres)
        if "aligned_attention" in extensions:
            align_attention(self)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean dance."""
        self.check(x_t, t, conditions)
        decoder, parts, run = self.decoder, self.parts, self.prepare(x_t, t, conditions)
        h = parts.tokens(parts.embed(decoder.embed(x_t), run), run)
        music, steps, cond = decoder.condition(t, conditions)
        w = decoder.group_embedding(conditions.latent, music, x_t.shape[1])
        h = decoder.decode(h, [music, steps], parts.film(cond, run), w)
        return parts.read(decoder.read(h), h, run)


class ExtendedTCDiff(Extended, TCDiff):
    """TCDiff with extensions of its second stage; shapes as `TCDiff`.

    >>> import torch
    >>> sizes = {"d_model": 16, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 32}
    >>> model = ExtendedTCDiff(TCDiffConfig(**sizes), ["preconditioning"])
    >>> conditions = Conditions(torch.randn(2, 20, 35), path=torch.zeros(2, 3, 20, 2))
    >>> model(torch.randn(2, 3, 20, 151), torch.tensor([10, 900]), conditions).shape
    torch.Size([2, 3, 20, 151])
    """

    def __init__(
        self, config: TCDiffConfig, extensions: Sequence[str], genres: Sequence[str] = GENRES
    ):
        super().__init__(config)
        self.parts = parts_of(config, extensions, genres=genres)
        if "aligned_attention" in extensions:
            align_attention(self.decoder)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean dance."""
        path = self.check(x_t, t, conditions)
        decoder, parts = self.decoder, self.parts
        x_t = on_path(x_t, path)
        run = self.prepare(x_t, t, conditions)
        h = parts.tokens(decoder.place(parts.embed(decoder.embed(x_t), run)), run)
        music, steps, cond = decoder.condition(t, conditions)
        cond, context = parts.film(cond, run), decoder.context(t, path)
        h = decoder.decode(h, [music, steps], cond, context)
        return on_path(parts.read(decoder.read(h), h, run), path)

    def linear_guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What preconditioning guesses without the network, on the path."""
        path = self.check(x_t, t, conditions)
        return on_path(super().linear_guess(on_path(x_t, path), t, conditions), path)


def frame_tokens(
    decoder: MusicConditioning, c: Any, extensions: Sequence[str]
) -> FrameTokens | None:
    """Tokens of several frames for a decoder and its music, if the extensions say so."""
    if "frame_tokens" not in extensions:
        return None
    pool_music(decoder, c)
    return FrameTokens(c.d_model)


def parts_of(
    c: Any,
    extensions: Sequence[str],
    num_frames: int | None = None,
    *,
    genres: Sequence[str] = GENRES,
) -> Parts:
    """The parts among the extensions of a config, in the order in which they take their turns.

    ``num_frames``: that follow one another in what the network makes; default: the config's.
    ``genres``: names for the genre condition.
    """
    f = num_frames or c.num_frames
    make: dict[str, Callable[[], Part]] = {
        "formation_prior": lambda: FormationPrior(
            c.max_dancers, f, use_swap="swap_mode" not in c.without
        ),
        "genre_prior": lambda: GenrePrior(len(genres), f, c.motion_dim),
        "preconditioning": lambda: LinearStart(c.d_model, c.motion_dim, f),
        "foot_cues": lambda: FootCues(c.d_model),
        "beat_phase": lambda: BeatPhase(c.d_model),
        "genre_condition": lambda: GenreCondition(c.d_model, genres),
        "energy_condition": lambda: EnergyCondition(c.d_model),
        "non_local_filter": lambda: NonLocalFilter(c.d_model, c.motion_dim),
    }
    return Parts({name: make[name]() for name in make if name in extensions})
