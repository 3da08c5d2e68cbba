r"""Lodge's two networks with extensions: the plain networks, step by step, with parts in between.

Read first: `dancediff.papers.lodge.global_diffusion` and `dancediff.papers.lodge.local_diffusion`,
the networks as the paper has them · `dancediff.extensions.parts`.

    style_film      the style token joins the vector of FiLM
    global_style    the genre is an input of the first stage, too, so that primitives depend on it

In the first stage preconditioning takes each primitive for itself, since its neighbours are seconds
away, and energy is that of the frames which the tokens stand for. Beat phase is not for it: soft
primitives are moved to a beat only after they are made.

Symbols (axes: b batch · p primitives · f frames · d motion features)
    x_t      noisy motion, normalised              (b, f, d), in the first stage (b, p 8, d)
"""

from collections.abc import Sequence
from dataclasses import replace

from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.aligned_attention import align_attention
from dancediff.extensions.networks import Extended, frame_tokens, parts_of
from dancediff.extensions.parts import Pass
from dancediff.papers.lodge.global_diffusion import GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.lodge.style import StyleToken

OF_GLOBAL = ("preconditioning", "energy_condition")  # parts that the first stage has, too


def extended_lodge(config: LodgeConfig, extensions: Sequence[str]) -> Lodge:
    """Both stages, each with those of the extensions that it has."""
    first = ExtendedGlobalDenoiser(config, extensions)
    model = Lodge(config, first, ExtendedLocalDenoiser(config.local_stage, extensions))
    if "aligned_attention" in extensions:
        align_attention(model)
    return model


class ExtendedGlobalDenoiser(Extended, GlobalDenoiser):
    r"""The first stage with extensions.

    Shapes: as `GlobalDenoiser`; with "global_style" the conditions have a style (b, d_model).
    """

    def __init__(self, config: LodgeConfig, extensions: Sequence[str]):
        c = config.global_stage
        super().__init__(c)
        self.extensions = tuple(extensions)
        self.style_film = "style_film" in extensions
        own = [name for name in extensions if name in OF_GLOBAL]
        self.parts = parts_of(c, own, c.num_frames // c.clips)
        if "global_style" in extensions:
            genres, noise = config.local_stage.genres, config.local_stage.style_noise
            self.style = StyleToken(c.d_model, len(genres), noise)

    def prepare(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Pass:
        """Begin a pass in which primitives are apart, (b, p, 8, d); energy is that of tokens."""
        if conditions.energy is not None:
            at_tokens = conditions.energy[:, self.frames.long()]
            conditions = replace(conditions, energy=at_tokens)
        return super().prepare(self.clips(x_t), t, conditions)

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """Guess the clean primitives."""
        self.check(x_t, t, conditions)
        decoder, run = self.decoder, self.prepare(x_t, t, conditions)
        music, steps, cond = decoder.condition(t, conditions)
        memory = [music, steps]
        if self.style is not None:
            assert conditions.style is not None  # `check` has looked
            style = conditions.style.float()
            memory.append(style[:, None])
            cond = cond + style if self.style_film else cond
        h = self.parts.embed(self.clips(decoder.embed(x_t)), run).flatten(1, 2)
        h = decoder(self.parts.tokens(h, run), memory, cond, self.frames)
        return self.parts.read(self.clips(decoder.read(h)), self.clips(h), run).flatten(1, 2)

    def linear_guess(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> Tensor:
        """What preconditioning guesses without the network, (b, f, d)."""
        return super().linear_guess(x_t, t, conditions).flatten(1, 2)


class ExtendedLocalDenoiser(Extended, LocalDenoiser):
    r"""The second stage with extensions; shapes as `LocalDenoiser`.

    With preconditioning the correction of the feet passes through it as well, so that it is as
    smooth as dance is. The Foot Refine Block sees every frame, with or without frame tokens.
    """

    def __init__(self, config: LocalConfig, extensions: Sequence[str]):
        super().__init__(config)
        self.extensions = tuple(extensions)
        self.parts = parts_of(config, extensions)
        self.frame_tokens = frame_tokens(self.decoder, config, extensions)
        self.style_film = "style_film" in extensions

    def forward(self, x_t: Tensor, t: Tensor, conditions: Conditions) -> tuple[Tensor, Tensor]:
        """Guess the clean motion, before and after its feet are refined."""
        self.check(x_t, t, conditions)
        decoder, parts, run = self.decoder, self.parts, self.prepare(x_t, t, conditions)
        music, steps, cond = decoder.condition(t, conditions)
        assert conditions.style is not None  # `check` has looked
        style = conditions.style.float()
        cond = cond + style if self.style_film else cond
        h = parts.tokens(parts.embed(decoder.embed(x_t), run), run)

        def layers(h: Tensor) -> Tensor:
            return decoder(h, [music, steps, style[:, None]], cond, self.frames[: h.shape[1]])

        if self.frame_tokens is None:
            h = layers(h)
        else:
            low = self.frame_tokens.pool(h)  # (b, f / 3, d_model)
            h = self.frame_tokens.unpool(layers(low), h)
        x_raw = parts.read(decoder.read(h), h, run)
        delta = self.foot_refine(x_raw, self.feet(x_raw), steps, cond)
        return x_raw, parts.adapt(x_raw + delta, x_raw, run)
