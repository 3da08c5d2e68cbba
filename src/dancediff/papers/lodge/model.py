r"""Lodge: a long song in, a long dance out.

Read first: notebook 12 · Lodge section 3 · `dancediff.papers.lodge.parallel`.

Symbols (axes: F frames of the dance · d motion features)
    global stage   music of 34 s -> primitives, see `dancediff.papers.lodge.global_diffusion`
    local stage    music of 8.5 s and cues -> dance, see `dancediff.papers.lodge.local_diffusion`
"""

from dataclasses import dataclass, field

from torch import Tensor, nn

from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser


@dataclass(frozen=True)
class LodgeConfig:
    """The sizes of both stages, by default the paper's; plain values, to be stored as JSON.

    Raises: ValueError when the stages do not go together.

    >>> LodgeConfig().num_frames, LodgeConfig().genres[0]
    (256, 'Breaking')
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
        for name in ("motion_dim", "music_dim", "num_steps"):
            if getattr(coarse, name) != getattr(fine, name):
                raise ValueError(
                    f"{name}={getattr(coarse, name)} of the global stage must be that of the "
                    f"local one, {getattr(fine, name)}"
                )

    @property
    def genres(self) -> tuple[str, ...]:
        """Names, in the order of their numbers."""
        return self.local_stage.genres

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

    Source: Lodge section 3.

    >>> tiny = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
    >>> model = Lodge(LodgeConfig(GlobalConfig(**tiny), LocalConfig(**tiny)))
    >>> sum(p.numel() for p in model.parameters())
    82833
    """

    stages = ("global", "local", "fine_tune")  # the trainings it needs, one after the other

    def __init__(
        self,
        config: LodgeConfig | None = None,
        global_stage: GlobalDenoiser | None = None,
        local_stage: LocalDenoiser | None = None,
    ):
        """Random weights, or two stages that are there already."""
        super().__init__()
        self.config = config = config or LodgeConfig()
        self.global_stage = global_stage or GlobalDenoiser(config.global_stage)
        self.local_stage = local_stage or LocalDenoiser(config.local_stage)

    @property
    def abar(self) -> Tensor:
        """The noise schedule; it is where the model is."""
        return self.local_stage.abar
