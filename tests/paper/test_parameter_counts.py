"""Weights of the published sizes, worked out by hand; the table is in docs/differences.md.

Nothing here is read off the modules but what is compared.
"""

import pytest
import torch

from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

D, FF, HIDDEN, FRAMES, MUSIC, MOTION = 512, 1024, 1024, 150, 35, 151


def linear(into, out, bias=True):
    return into * out + out * bias


def build(max_dancers, **changes):
    with torch.device("meta"):
        return TCDiffPP(TCDiffPPConfig.paper(max_dancers=max_dancers, **changes))


def count(module):
    return sum(p.numel() for p in module.parameters())


ATTENTION = linear(D, D) + linear(D, 2 * D) + linear(D, D)
FEED_FORWARD = linear(D, FF) + linear(FF, D)
NORM, FILM = 2 * D, linear(D, 2 * D)
MAMBA = (
    linear(D, 4 * D, bias=False)  # in: u and gate, each 2 d
    + (4 * 2 * D + 2 * D)  # filter over 4 frames
    + linear(2 * D, 32 + 16 + 16, bias=False)  # Delta', B, C
    + linear(32, 2 * D)  # Delta
    + 16 * 2 * D  # A
    + 2 * D  # D
    + linear(2 * D, D, bias=False)  # out
)
LAYER = 2 * ATTENTION + FEED_FORWARD + MAMBA + 4 * (NORM + FILM)


def squash(into, out):
    return linear(into, out) + linear(2, out) + linear(2, out, bias=False)


def by_hand(C):
    return {
        "embed": linear(MOTION, D),
        "dancer_positioning": C * D,
        "fusion_projection": linear(C * D, HIDDEN) + linear(HIDDEN, HIDDEN) + linear(HIDDEN, C * D),
        "swap_mode": C * C * D + linear(D, D),
        "timestep": linear(D, 4 * D) + linear(4 * D, D) + linear(4 * D, 2 * D),
        "music": linear(MUSIC, D) + 2 * (ATTENTION + FEED_FORWARD + 2 * NORM),
        "pooled_music": NORM + 2 * linear(D, D),
        "null_music": FRAMES * D,
        "null_pooled": D,
        "sequence_decoder": NORM + 8 * LAYER,
        "out": linear(D, MOTION),
        "footwork_adaptor": squash(MOTION, 128) + squash(128, 128) + squash(128, MOTION),
    }


@pytest.mark.parametrize("C", [2, 3, 4, 5])
def test_every_component(C):
    model = build(C)
    for name, size in by_hand(C).items():
        owner = model if name == "footwork_adaptor" else model.decoder
        part = getattr(owner, name)
        assert (part.numel() if isinstance(part, torch.Tensor) else count(part)) == size, name


@pytest.mark.parametrize(
    ("C", "total"), [(2, 68_265_249), (3, 69_317_409), (4, 70_370_593), (5, 71_424_801)]
)
def test_the_whole_model(C, total):
    assert count(build(C)) == total == sum(by_hand(C).values())


def test_known_sizes_of_single_parts():
    """Numbers that were worked out from the papers and EDGE's code before this was written."""
    assert MAMBA == 1_694_720 and FILM == 525_312
    assert ATTENTION + FEED_FORWARD + 2 * NORM == 2_102_784  # a layer of the music encoder
    edge_layer = 2 * ATTENTION + FEED_FORWARD + 3 * (NORM + FILM)
    assert edge_layer == 4_730_368 and LAYER == edge_layer + MAMBA + NORM + FILM == 6_951_424
    assert by_hand(2)["footwork_adaptor"] == 57_482
    assert [round(by_hand(C)["fusion_projection"] / 1e6, 2) for C in (2, 3, 4, 5)] == [
        3.15,
        4.2,
        5.25,
        6.3,
    ]


def test_what_the_state_space_model_costs():
    assert count(build(5)) - count(build(5, without=("ssm",))) == 8 * (MAMBA + NORM + FILM)
