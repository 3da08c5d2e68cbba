"""The registry: everything that this library adds to the papers, with what each addition needs.

Read first: docs/extending.md.

Parts of networks and hooks stand in the order in which they act. The page
docs/how_a_dance_is_made.md is made from it, and tests hold it against modules and presets. What
dances lose without an addition: docs/ablations.md, measured by benchmarks/extensions.py.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

KINDS = ("network", "training", "hook", "guidance", "sampling")
# modules that several extensions use
SHARED = (
    "build",
    "constraint",
    "group_modes",
    "networks",
    "own_network",
    "parts",
    "projection",
    "registry",
    "spectrum",
)


@dataclass(frozen=True)
class Extension:
    """One addition; ``module`` is where it is, ``needs`` are other names of the registry.

    ``models``: families that can have it. ``packaged``: those whose packaged weights were made with
    it, or whose packaged preset uses it; without it all. ``lesson``: the notebook that shows it, if
    one does.
    """

    name: str
    kind: str
    summary: str
    module: str
    models: tuple[str, ...]
    packaged: tuple[str, ...] | None = None
    needs: tuple[str, ...] = ()
    lesson: int | None = None

    def packaged_in(self, model: str) -> bool:
        """Has what comes with dancediff for that family it?

        >>> REGISTRY["ssd"].packaged_in("tcdiffpp"), REGISTRY["ssd"].packaged_in("lodge")
        (True, False)
        """
        return model in (self.models if self.packaged is None else self.packaged)


GROUP, SOLO = ("tcdiffpp",), ("lodge",)
BY_SEGMENTS = ("tcdiffpp", "edge", "gcd", "tcdiff")
ALL = (*BY_SEGMENTS, "lodge")
LINEAR = ("preconditioning",)

_ALL = (
    # network
    Extension("formation_prior", "network", "The linear guess knows formations and swap modes.",
              "formation_prior", GROUP, needs=LINEAR, lesson=7),
    Extension("genre_prior", "network", "The linear guess knows genres.", "genre_prior",
              BY_SEGMENTS, packaged=GROUP, needs=(*LINEAR, "genre_condition")),
    Extension("preconditioning", "network", "The network adds to the best linear guess.",
              "preconditioning", ALL, lesson=4),
    Extension("foot_cues", "network", "Heights and speeds of a guess's feet are an input.",
              "foot_cues", GROUP, needs=LINEAR, lesson=9),
    Extension("beat_phase", "network", "How far a frame is between two beats is an input.",
              "beat_phase", ALL),
    Extension("genre_condition", "network", "A genre, or a mix of genres, can be asked for.",
              "genre_condition", BY_SEGMENTS),
    Extension("energy_condition", "network", "How full the music is in each frame is an input.",
              "energy_condition", ALL),
    Extension("non_local_filter", "network", "Frames that look alike are averaged.",
              "non_local_filter", ALL, needs=LINEAR),
    Extension("frame_tokens", "network", "Layers see three frames as one token.", "frame_tokens",
              ("tcdiffpp", "edge", "lodge")),
    Extension("aligned_attention", "network", "Half of the heads start at their own frame.",
              "aligned_attention", ALL),
    Extension("ssd", "network", "State space models with one decay a head: matrix products.",
              "ssd", GROUP, lesson=8),
    Extension("footwork_residual", "network", "The Footwork Adaptor corrects legs.",
              "residuals", GROUP),
    Extension("fusion_residual", "network", "The mixed dancers are added to their own tokens.",
              "residuals", GROUP),
    Extension("last_frame_residual", "network", "Guesses are added to the last frame seen.",
              "last_frame_residual", ("fact", "mnet"), lesson=14),
    Extension("style_film", "network", "Lodge's style token joins the vector of FiLM.",
              "lodge_stages", SOLO),
    Extension("global_style", "network", "Lodge's first stage gets the genre, too.",
              "lodge_stages", SOLO),
    # training
    Extension("metre_unit", "training", "A metre is the unit of the floor.", "metre_unit", ALL),
    Extension("level_weights", "training", "Noise levels count by how hard they are.",
              "level_weights", ALL, needs=LINEAR),
    Extension("both_guesses", "training", "Guesses before and after their feet are reconstructed.",
              "both_guesses", ALL, packaged=("tcdiffpp", "lodge")),
    Extension("hard_contact", "training", "In the losses feet are planted or not.",
              "hard_contact", ALL, lesson=5),
    Extension("joint_velocity_loss", "training", "Velocities of joints count.",
              "joint_velocity_loss", ALL, packaged=BY_SEGMENTS),
    Extension("slide_loss", "training", "Feet that truly stand should not slide.",
              "slide_loss", ALL),
    Extension("own_overlap", "training", "Windows begin as the network itself makes them.",
              "own_overlap", GROUP),
    Extension("masked_music", "training", "Timbre and harmony are hidden.", "training.config", ALL,
              packaged=()),
    Extension("music_dropout", "training", "Some windows lack timbre, some harmony.",
              "music_dropout", ALL),
    Extension("any_song", "training", "Real dances are also learned to other dances' songs.",
              "training.config", ALL),
    # guidance
    Extension("autoguidance", "guidance", "Guesses are pushed away from the linear one.",
              "autoguidance", ALL, needs=LINEAR, lesson=6),
    Extension("genre_guidance", "guidance", "What a genre that is asked for changes counts double.",
              "genre_guidance", GROUP, needs=("genre_condition",)),
    Extension("frequency_clip", "guidance", "Guesses are cut frequency by frequency, not at +-1.",
              "frequency_clip", BY_SEGMENTS, needs=LINEAR),
    # hooks on guesses
    Extension("initial_frames", "hook", "A segment starts where the last one ended.",
              "initial_frames", GROUP, needs=(*LINEAR, "same_noise"), lesson=10),
    Extension("control", "hook", "Places, paths and parts of other dances are met.", "control",
              GROUP, needs=(*LINEAR, "same_noise"), lesson=10),
    Extension("order_constraint", "hook", "Who is asked to change places ends there.",
              "order_constraint", GROUP, needs=LINEAR, lesson=9),
    Extension("collision_avoidance", "hook", "Dancers who would collide make room.",
              "collision_avoidance", GROUP, needs=LINEAR),
    Extension("stage_spots", "hook", "Segments of 8.5 s end at spots near the middle.",
              "stage_spots", SOLO, needs=(*LINEAR, "root_stitching"), lesson=12),
    Extension("border_smoothing", "hook", "Cues are met without a jerk.", "border_smoothing", SOLO,
              needs=LINEAR),
    Extension("speed_limit", "hook", "Joints turn and dancers travel within a limit.",
              "speed_limit", ALL),
    Extension("floor_contact", "hook", "Bodies neither float nor sink.", "floor_contact", ALL,
              lesson=9),
    Extension("foot_contact_projection", "hook", "Feet that stand do not slide.",
              "foot_contact_projection", ALL, lesson=9),
    # sampling
    Extension("dpm_solver", "sampling", "DPM-Solver++ instead of DDIM: fewer steps.",
              "diffusion.dpm_solver", ALL, lesson=6),
    Extension("same_noise", "sampling", "The context keeps its noise while it is pinned.",
              "diffusion.pinning", GROUP, lesson=10),
    Extension("resampled_overlap", "sampling", "Shared frames are sampled again for constraints.",
              "diffusion.long_sampling", GROUP, needs=("control",)),
    Extension("smooth_primitives", "sampling", "Primitives keep pose, velocity and acceleration.",
              "smooth_primitives", SOLO),
    Extension("repeat_sections", "sampling", "Soft cues come again when the music does.",
              "repeat_sections", SOLO),
    Extension("root_stitching", "sampling", "Dancers go on over seams from where they are.",
              "root_stitching", SOLO, lesson=12),
    Extension("group_relations", "sampling", "A group dances a solo: in unison, canon or mirror.",
              "group_relations", SOLO),
)  # fmt: skip
REGISTRY = {extension.name: extension for extension in _ALL}


def check_training(
    table: Mapping[str, Any], family: str, network: Sequence[str], source: str
) -> None:
    """Can a family whose network has these extensions be trained as a table [extensions] says?

    Raises: ValueError naming the source, the key, its value, and who can have it or what it needs.

    >>> check_training({"own_overlap": 0.25}, "lodge", ["preconditioning"], "a.toml: 'extensions'")
    Traceback (most recent call last):
    ValueError: a.toml: 'extensions': own_overlap=0.25 is for tcdiffpp, not for lodge; leave it out
    """
    for name, value in table.items():
        extension = REGISTRY.get(name)  # none of a loss of the user's own
        if extension is None or not value:
            continue
        if family not in extension.models:
            raise ValueError(
                f"{source}: {name}={value!r} is for {', '.join(extension.models)}, "
                f"not for {family}; leave it out"
            )
        for needed in extension.needs:
            if needed not in network:
                raise ValueError(
                    f"{source}: {name}={value!r} needs {needed!r} in extensions of [model]; "
                    f"name it there, or leave {name} out"
                )
