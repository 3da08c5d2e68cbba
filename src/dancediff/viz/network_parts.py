"""Boxes and arrows of the pictures of TCDiff++ and Lodge: what they stand for, and where.

Read first: `dancediff.viz.network_picture`, which draws them.

All places are in a picture that is 700 wide. A box names a part of the network; an arrow names the
part whose input or output runs along it, so that its shape is that of the network drawn.
"""

from dataclasses import dataclass

LESSONS = {
    5: "05_a_denoiser_that_listens",
    6: "06_the_sampling_lab",
    7: "07_who_stands_where",
    8: "08_a_memory_for_time",
    9: "09_changing_places",
    10: "10_a_long_group_dance",
    11: "11_think_in_phrases",
    12: "12_fill_in_the_rest",
}
ROW = 24  # height of a block in a layer


@dataclass(frozen=True)
class Box:
    """A part, or with ``frame`` an outline around several; ``key`` is its name for `lit`.

    ``words`` may ask for sizes of the network, such as "{seconds}".
    """

    key: str
    words: str
    x: float
    y: float
    width: float
    height: float
    lesson: int
    module: str = ""  # of the network; nothing: a step outside it
    frame: bool = False


@dataclass(frozen=True)
class Arrow:
    """A line through points; its shape is that of input or output ``index`` of a part."""

    points: tuple[tuple[float, float], ...]
    module: str = ""
    side: str = "out"
    index: int = 0
    label: tuple[float, float] | None = None  # where the shape stands; else by the first piece
    words: str = ""  # before the shape
    needs: str = ""  # a part without which there is no arrow


@dataclass(frozen=True)
class Word:
    """Something that goes in or comes out."""

    text: str
    x: float
    y: float


@dataclass(frozen=True)
class Diagram:
    """A picture: its height, and what is in it. Frames come first: they lie below."""

    about: str
    height: float
    boxes: tuple[Box, ...]
    arrows: tuple[Arrow, ...]
    words: tuple[Word, ...]


def blocks(path: str, key: str, x: float, y: float, lessons: dict[str, int]) -> list[Box]:
    """The blocks of one decoder layer, one below the other."""
    names = {
        "self_attention": "self-attention",
        "ssm": "memory (SSM)",
        "cross_attention": "cross-attention",
        "feed_forward": "feed-forward",
    }
    return [
        Box(key, names[name], x, y + k * (ROW + 4), 104, ROW, lesson, f"{path}.layers.0.{name}")
        for k, (name, lesson) in enumerate(lessons.items())
    ]


def right(x: float, y: float, length: float, module: str, **more) -> Arrow:
    """An arrow to the right."""
    return Arrow(((x, y), (x + length, y)), module, **more)


SD = "decoder.sequence_decoder"
TCDIFFPP = Diagram(
    "TCDiff++: from a noisy group and its music to a clean guess",
    430,
    (
        Box(
            "long_sampling", "long sampling: segment after segment, each goes on from the last",
            4, 4, 692, 422, 10, frame=True,
        ),
        Box(
            "sampler", "sampler: mix the guess with a little less noise, and ask again",
            118, 36, 464, 30, 6,
        ),
        Box("decoder", "Linear", 76, 176, 52, 44, 5, "decoder.embed"),
        Box("dancer_positioning", "Dancer\nPositioning\n(DPE)", 164, 168, 72, 60, 7,
            "decoder.dancer_positioning"),
        Box("fusion_projection", "Fusion\nProjection\n(FP)", 272, 168, 68, 60, 7,
            "decoder.fusion_projection"),
        Box("sequence_decoder", "Sequence Decoder", 376, 110, 120, 150, 8, SD),
        *blocks(SD, "sequence_decoder", 384, 140,
                {"self_attention": 5, "ssm": 8, "cross_attention": 5, "feed_forward": 5}),
        Box("decoder", "Linear", 532, 176, 50, 44, 5, "decoder.out"),
        Box("footwork_adaptor", "Footwork\nAdaptor", 618, 172, 66, 52, 9, "footwork_adaptor"),
        Box("music", "music encoder", 196, 330, 96, 34, 5, "decoder.music"),
        Box("timestep", "step encoder", 326, 330, 92, 34, 5, "decoder.timestep"),
        Box("swap_mode", "swap mode\nembedding", 448, 330, 84, 34, 9, "decoder.swap_mode"),
        Box("losses", "losses: how far from\nthe true dance?", 562, 330, 122, 40, 5),
    ),
    (
        right(48, 198, 28, "decoder.embed", side="into"),
        right(128, 198, 36, "decoder.embed"),
        right(236, 198, 36, "decoder.dancer_positioning"),
        right(340, 198, 36, "decoder.fusion_projection"),
        right(496, 198, 36, SD),
        right(582, 198, 36, "decoder.out"),
        Arrow(((670, 172), (670, 51), (582, 51)), "footwork_adaptor", label=(640, 120)),
        Arrow(((118, 51), (30, 51), (30, 186))),
        Arrow(((650, 224), (650, 330)), "footwork_adaptor", label=(622, 250)),
        Arrow(((244, 330), (244, 296), (410, 296), (410, 260)), SD, side="into", index=1,
              label=(340, 290), words="memory tokens: "),
        Arrow(((356, 330), (356, 296), (410, 296), (410, 260))),
        Arrow(((476, 330), (476, 296), (410, 296), (410, 260))),
        Arrow(((388, 330), (388, 312), (460, 312), (460, 260)), SD, side="into", index=2,
              label=(512, 290), words="FiLM vector: "),
        Arrow(((504, 330), (504, 312), (460, 312), (460, 260))),
        Arrow(((272, 330), (272, 312), (460, 312), (460, 260))),
        Arrow(((244, 390), (244, 364)), "decoder.music", side="into"),
        Arrow(((372, 390), (372, 364))),
        Arrow(((490, 390), (490, 364)), "decoder.swap_mode", side="into"),
    ),
    (
        Word("noisy", 30, 196), Word("dance", 30, 208),
        Word("music", 244, 402), Word("noise level t", 372, 402), Word("swap mode S", 490, 402),
    ),
)  # fmt: skip


def stage(path: str, key: str, y: float, lesson: int) -> tuple[list[Box], list[Arrow]]:
    """The chain of one of Lodge's stages: map, layers, map, with the conditions below."""
    d = f"{path}.decoder"
    boxes = [
        Box(key, "Linear", 92, y + 40, 52, 40, lesson, f"{d}.embed"),
        Box(key, "decoder layers", 190, y, 120, 118, lesson, f"{d}.layers.0"),
        *blocks(d, key, 198, y + 30,
                {"self_attention": 5, "cross_attention": 5, "feed_forward": 5}),
        Box(key, "Linear", 356, y + 40, 52, 40, lesson, f"{d}.out"),
        Box(key, "music encoder", 92, y + 150, 92, 26, 5, f"{d}.music"),
        Box(key, "step encoder", 204, y + 150, 88, 26, 5, f"{d}.timestep"),
        Box(key, "style token", 312, y + 150, 84, 26, 11, f"{path}.style"),
    ]  # fmt: skip
    arrows = [
        right(56, y + 60, 36, f"{d}.embed", side="into"),
        right(144, y + 60, 46, f"{d}.embed"),
        right(310, y + 60, 46, f"{d}.layers.0"),
        Arrow(((138, y + 150), (138, y + 134), (250, y + 134), (250, y + 118)),
              f"{d}.layers.0", side="into", index=1, label=(176, y + 129), words="memory tokens: "),
        Arrow(((248, y + 150), (248, y + 118))),
        Arrow(((354, y + 150), (354, y + 134), (250, y + 134), (250, y + 118)),
              needs=f"{path}.style"),
    ]  # fmt: skip
    return boxes, arrows


GLOBAL, GLOBAL_ARROWS = stage("global_stage", "global_stage", 34, 11)
LOCAL, LOCAL_ARROWS = stage("local_stage", "local_stage", 318, 12)
LODGE = Diagram(
    "Lodge: from a song to its key motions, and from those to the whole dance",
    514,
    (
        Box("global_stage", "global stage: key motions of {seconds:.0f} s", 4, 4, 692, 216, 11,
            frame=True),
        Box("local_stage", "local stage: everything between, all segments at once", 4, 288, 692,
            222, 12, frame=True),
        *GLOBAL,
        Box("primitives", "{primitives} primitives\nof {frames} frames", 472, 68, 112, 52, 11),
        Box("cues", "cues: hard ones cut in half at the borders of segments, "
            "soft ones danced twice, once mirrored", 90, 238, 520, 32, 12),
        *LOCAL,
        Box("foot_refine", "Foot Refine\nBlock (FRB)", 456, 352, 84, 52, 12,
            "local_stage.foot_refine"),
        Box("stitching", "join the\nsegments", 604, 352, 76, 52, 12),
        Box("critic", "critic: real or made?\n(training only)", 510, 456, 122, 38, 12),
    ),
    (
        *GLOBAL_ARROWS,
        *LOCAL_ARROWS,
        right(408, 94, 64, "global_stage.decoder.out"),
        Arrow(((528, 120), (528, 238))),
        Arrow(((110, 270), (110, 306), (34, 306), (34, 362))),
        right(408, 378, 48, "local_stage.decoder.out"),
        right(540, 378, 64, "local_stage.foot_refine"),
        Arrow(((588, 378), (588, 456))),
        Arrow(((60, 197), (92, 197)), "global_stage.decoder.music", side="into"),
        Arrow(((60, 481), (92, 481)), "local_stage.decoder.music", side="into"),
    ),
    (
        Word("noise", 32, 98), Word("song", 34, 201),
        Word("noise and", 32, 376), Word("cues", 32, 388), Word("song", 34, 485),
    ),
)  # fmt: skip
