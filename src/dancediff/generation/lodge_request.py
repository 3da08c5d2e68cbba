"""What can be asked of Lodge."""

from dataclasses import dataclass
from typing import Any, ClassVar, Self

from dancediff.generation.diffusion_request import DiffusionRequest
from dancediff.generation.option import option


@dataclass(frozen=True, kw_only=True)
class LodgeRequest(DiffusionRequest):
    """What can be asked of Lodge: a solo, also danced by a group."""

    family: ClassVar[str] = "lodge"

    dancers: int = option(1, "How many people dance, all the same solo.", low=1, high=5)
    soft: float = option(
        None,
        "For which share of the way from noise to dance it is held at its soft cues.",
        low=0,
        high=1,
    )
    mirror: bool = option(True, "Dance each soft cue a second time, mirrored.")
    beat_align: bool = option(True, "Put soft cues on beats.")
    repeat_sections: bool = option(
        None, "A section of the song that comes again gets the soft cues of its first time."
    )
    smooth_primitives: bool = option(
        None, "Keep pose, velocity and acceleration of a primitive, not its jitter."
    )
    border_smoothing: bool = option(
        None, "Change the frames beside hard cues so that these are met without a jerk."
    )
    root_stitching: bool = option(
        None, "Go on over seams from where the segment before ended; else back to the middle."
    )
    stage_spots: bool = option(
        None, "Be at a spot near the middle every 8.5 s; without it a dancer may walk off."
    )
    formation: str = option("line", "Where the dancers of a group begin, such as 'line' or 'V'.")
    relation: str = option(
        "unison",
        "All the same, each four beats later than the one to the left, or mirrored.",
        choices=("unison", "canon", "mirror"),
    )
    at_once: int | None = option(
        16, "Segments in memory together (16 are two minutes), None: all; the dance is the same.",
        low=1,
    )  # fmt: skip

    def resolve(self, model, song) -> Self:
        """As `DiffusionRequest.resolve`; the formation must have a place for everybody."""
        from dancediff.extensions.group_relations import places

        filled = super().resolve(model, song)
        places(filled.dancers, filled.formation)
        return filled

    def usual(self, model) -> dict[str, Any]:
        """As `DiffusionRequest.usual`: also what another option or the first stage rules out."""
        asked, usual = self.asked(), super().usual(model)
        needs = []
        if not asked.get("root_stitching", usual["root_stitching"]):
            needs.append(("stage_spots", "root_stitching=True"))
        if model.global_stage.config.variant == "discrete":
            needs.append(("smooth_primitives", "a first stage with variant='continuous'"))
        for name, need in needs:
            if asked.get(name):
                raise ValueError(f"{name}=True needs {need}; use False")
            usual[name] = False
        return usual

    def facts(self) -> dict:
        """As `DiffusionRequest.facts`; a solo has no formation."""
        of_groups = ("formation", "relation") if self.dancers == 1 else ()
        return {name: value for name, value in super().facts().items() if name not in of_groups}
