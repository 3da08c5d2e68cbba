r"""Lodge: a long song in, a long dance out.

Read first: notebook 12 · Lodge section 3 · `dancediff.papers.lodge.parallel`.

Symbols (axes: n dancers · F frames of the dance · d motion features)
    global stage   music of 34 s -> primitives, see `dancediff.papers.lodge.global_diffusion`
    local stage    music of 8.5 s and cues -> dance, see `dancediff.papers.lodge.local_diffusion`
"""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields
from functools import partial

import torch
from torch import Tensor, nn

from dancediff.generation.generate import generate, stream
from dancediff.motion.motion import Motion
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.group import places
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.staging import Staging, describe, draw_group, draw_pieces

MAX_DANCERS = 5  # for whom there are formations


@dataclass
class LodgeConfig:
    """The sizes of both stages; plain values, so that it can be stored as JSON.

    Raises: ValueError when the stages do not go together.

    >>> LodgeConfig().num_frames, LodgeConfig().genres[0]
    (256, 'hiphop')
    """

    global_stage: GlobalConfig = field(default_factory=GlobalConfig)
    local_stage: LocalConfig = field(default_factory=LocalConfig)

    def __post_init__(self):
        coarse, fine = self.global_stage, self.local_stage
        if coarse.local_frames != fine.num_frames:
            raise ValueError(
                f"local_frames={coarse.local_frames} of the global stage must be "
                f"num_frames={fine.num_frames} of the local one"
            )
        if coarse.genres and coarse.genres != fine.genres:
            raise ValueError(f"genres={coarse.genres} differ from the local stage's {fine.genres}")
        for name in ("motion_dim", "music_dim", "num_steps"):
            if getattr(coarse, name) != getattr(fine, name):
                raise ValueError(
                    f"{name}={getattr(coarse, name)} of the global stage must be that of the "
                    f"local one, {getattr(fine, name)}"
                )

    @classmethod
    def paper(cls) -> "LodgeConfig":
        """Sizes of Lodge.

        >>> LodgeConfig.paper().global_stage.d_model
        512
        """
        return cls(GlobalConfig.paper(), LocalConfig.paper())

    @property
    def genres(self) -> tuple[str, ...]:
        """Names, in the order of their numbers."""
        return self.local_stage.genres

    @property
    def max_dancers(self) -> int:
        """How large a group may be."""
        return MAX_DANCERS

    @property
    def precondition(self) -> bool:
        """Have both stages a linear guess to start from?"""
        return self.global_stage.precondition and self.local_stage.precondition

    @property
    def num_frames(self) -> int:
        """Of a local segment."""
        return self.local_stage.num_frames

    @property
    def num_steps(self) -> int:
        """Of the noise schedule."""
        return self.local_stage.num_steps


class Lodge(nn.Module):
    r"""Both stages together.

    $$\text{primitives} = \text{global}(M), \qquad
      x = \text{local}(M, \text{cues}(\text{primitives}))$$

    Source: Lodge section 3.  Differs: see the two stages and `dancediff.papers.lodge.parallel`;
    groups are
    ours.

    >>> tiny = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
    >>> model = Lodge(LodgeConfig(GlobalConfig(**tiny), LocalConfig(**tiny)))
    >>> import dancediff as dd
    >>> model.generate(dd.packaged_song(), seconds=9, steps=2, dancers=2).num_frames
    270
    """

    name = "lodge"  # what dances made with it call it; a loaded folder puts its own name here

    def __init__(self, config: LodgeConfig | None = None):
        """Random weights; normalisers that change nothing until training fits them."""
        super().__init__()
        self.config = config = config or LodgeConfig()
        self.global_stage = GlobalDenoiser(config.global_stage)
        self.local_stage = LocalDenoiser(config.local_stage)

    @classmethod
    def of(cls, global_stage: GlobalDenoiser, local_stage: LocalDenoiser) -> "Lodge":
        """Put two trained stages together."""
        with torch.device("meta"):
            model = cls(LodgeConfig(global_stage.config, local_stage.config))
        model.global_stage, model.local_stage = global_stage, local_stage
        return model

    @property
    def abar(self) -> Tensor:
        """The noise schedule; it is where the model is."""
        return self.local_stage.abar

    def generate(
        self,
        song,
        *,
        dancers: int = 1,
        seconds: float | None = None,
        seed: int = 0,
        genre: str | None = None,
        soft: float = 1.0,
        home: bool = True,
        feet: str = "planted",
        mirror: bool = True,
        beat_align: bool = True,
        steps: int = 20,
        sampler: str = "dpm",
        guidance: float = 1.0,
        autoguidance: float | None = None,
        eta: float = 0.0,
        at_once: int | None = 16,
        formation: str = "line",
        relation: str = "unison",
        progress=False,
        device=None,
        dtype=None,
    ) -> Motion:
        """Dance to a song.

        - ``song``: a `Music`.  ``seconds``: how much of it, from its start; default all.
        - ``genre``: one of ``config.genres``; default: by the song's tempo, see `genre_for`.
        - ``soft``: for which share of the steps the dance is held at its soft cues, 0 to 1.
        - ``home``: come back to the same place every 8.5 s; without it a dancer may walk off.
        - ``feet``: "planted" keeps feet in place that stand;
          "free" leaves them as the network draws them.
        - ``mirror``: dance each soft cue a second time, mirrored.  ``beat_align``: on beats.
        - ``dancers``: 1 to 5, all with the same solo, in a ``formation`` ("line", "V", ...);
          ``relation`` "unison", "canon" (each 4 beats later than the one to her left) or "mirror".
        - ``seed``: the same seed on the same machine gives the same bits.
        - ``sampler`` "dpm" or "ddim" (``steps``, ``eta``: 0 = no fresh noise, 1 = as in the paper,
          which takes 50 steps of "ddim"), or "ddpm" (all 1000 steps).
        - ``guidance``: 0 ignores the music, 1 listens, 2 exaggerates (the papers' value).
        - ``autoguidance``: above 1 pushes guesses away from the mean of all dances
          (`dancediff.extensions.autoguidance.autoguided`); a model without preconditioning cannot;
          default 1.3 for one that can.
        - ``at_once``: segments in memory together (16 are two minutes), None: all; the dance is
          the same.
        - ``progress``: True for a bar, or a function (done, total).
        - ``device``: move the model there first.
        - ``dtype``: torch.bfloat16 computes with half the digits, which some processors do much
          faster; "fastest" tries that out (`dancediff.nn.precision`); default: all digits.

        Raises: ValueError naming the argument, its value and what is allowed; also for a silent
        song or one under a second.
        """
        staging = Staging(
            genre, soft, home, mirror, beat_align, at_once, formation, relation, self.config.genres
        )
        return generate(
            self,
            song,
            draw=partial(draw_group, staging=staging),
            describe=partial(describe, staging=staging),
            dancers=dancers,
            seconds=seconds,
            seed=seed,
            steps=steps,
            sampler=sampler,
            guidance=guidance,
            autoguidance=autoguidance,
            eta=eta,
            feet=feet,
            overlap=1,  # not used: segments share nothing but halves of primitives
            progress=progress,
            device=device,
            dtype=dtype,
        )

    def stream(self, song, **options) -> Iterator[Motion]:
        """The dance that `generate` makes of the same arguments, handed out a minute at a time.

        The solo is made first: 139 numbers a frame, 60 MB an hour, are held to its end. Everything
        else, above all the other dancers, is made for a piece only.

        >>> import dancediff as dd
        >>> pieces = dd.load("lodge").stream(dd.packaged_song(), seconds=9, steps=2)
        >>> [piece.num_frames for piece in pieces]
        [270]

        Raises: ValueError as `generate`.
        """
        own = {f.name: options.pop(f.name) for f in fields(Staging) if f.name in options}
        staging = Staging(**own, genres=self.config.genres)
        options = {"dancers": 1, "steps": 20, "overlap": 1} | options
        pieces = stream(
            self,
            song,
            draw=partial(draw_pieces, staging=staging),
            describe=partial(describe, staging=staging),
            **options,
        )
        places(options["dancers"], staging.formation)  # refuses here, not at the first piece
        return pieces
