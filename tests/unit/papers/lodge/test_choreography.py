from dataclasses import replace

import pytest
import torch

from dancediff.data.choreographer.structure import Section
from dancediff.extensions.repeat_sections import repeat_sections
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.papers.lodge.choreography import (
    Arrangement,
    arrange,
    chain,
    cue_positions,
    spread_evenly,
)
from dancediff.papers.lodge.cue_guidance import cue_channels
from dancediff.papers.lodge.primitives import DISCRETE, LAYOUT, Layout
from dancediff.papers.lodge.segments import segments_of


def numbered(G, layout=LAYOUT):
    """Primitives whose every entry says: global, primitive, frame."""
    g, p, k = torch.meshgrid(
        torch.arange(G), torch.arange(layout.num_primitives), torch.arange(8), indexing="ij"
    )
    return (g * 1000 + p * 10 + k).float()[..., None].expand(-1, -1, -1, 139).clone()


def random_primitives(G=1, layout=LAYOUT):
    g = torch.Generator().manual_seed(0)
    return torch.randn(G, layout.num_primitives, 8, 139, generator=g)


def make_cues(primitives, segments, **options):
    return arrange(primitives, segments, **{"mirror": True} | options).cues()


def mirrored(x):
    return mirror_features(x, LODGE)


def test_chain_keeps_the_border_of_the_global_before():
    row = chain(numbered(3), segments_of(3 * 1024))[:, 0, 0]
    assert len(row) == 37
    assert row[[0, 12, 13, 24, 25, 36]].tolist() == [0, 120, 1010, 1120, 2010, 2120]


def test_chain_takes_the_end_of_a_partial_last_global():
    for new in (1, 2, 3):
        row = chain(numbered(2), segments_of((4 + new) * 256))[:, 0, 0]
        assert len(row) == 3 * (4 + new) + 1
        # after the last hard primitive of the first: the soft ones of its last locals
        assert row[12:].tolist() == [120] + [1000 + 10 * p for p in range(13 - 3 * new, 13)]


def test_chain_of_a_short_song_takes_the_start_of_its_only_global():
    assert chain(numbered(1), segments_of(300))[:, 0, 0].tolist() == [0, 10, 20, 30, 40, 50, 60]


def test_primitives_of_another_plan_are_refused():
    for wrong in (numbered(2), numbered(1)[:, :10], numbered(1)[0]):
        with pytest.raises(ValueError, match="these segments need"):
            chain(wrong, segments_of(1024))


def test_both_sides_of_a_seam_hold_half_of_one_primitive():
    cues = make_cues(numbered(2), segments_of(2048), mirror=False)
    for j in range(7):
        seam = torch.cat([cues.value[j, -4:, 0], cues.value[j + 1, :4, 0]])
        assert (seam.diff() == 1).all()
    assert cues.value[0, :4, 0].tolist() == [4, 5, 6, 7]  # the second half of the first one
    assert cues.value[3, -4:, 0].tolist() == cues.value[3, -1, 0].sub(3 - torch.arange(4)).tolist()
    assert cues.value[3, -4, 0] == 120


def test_masks_count_what_the_paper_counts():
    cues = make_cues(random_primitives(), segments_of(1024))
    entries = (cues.hard | cues.soft)[..., None] & cue_channels()
    assert entries.sum((1, 2)).tolist() == [(4 + 4 + 4 * 8) * 136] * 4
    assert not (cues.hard & cues.soft).any()
    assert cues.hard.nonzero()[:8, 1].tolist() == [0, 1, 2, 3, 252, 253, 254, 255]
    assert (cues.value[~(cues.hard | cues.soft)] == 0).all()
    two = arrange(random_primitives(), segments_of(1024), mirror=False)
    assert two.cues().soft.sum(1).tolist() == [16] * 4 and two.positions.shape == (4, 2)


def test_soft_cues_come_twice_the_second_time_mirrored():
    primitives = random_primitives()
    made = arrange(primitives, segments_of(1024), mirror=True)
    cues = made.cues()
    for j in range(4):
        s, s2 = primitives[0, 3 * j + 1], primitives[0, 3 * j + 2]
        wanted = [s, mirrored(s), s2, mirrored(s2)]
        for at, cue in zip(made.positions[j].tolist(), wanted, strict=True):
            assert torch.equal(cues.value[j, at - 4 : at + 4], cue)


def test_cues_are_put_on_beats():
    beats = list(range(11, 2048, 17))
    made = arrange(random_primitives(2), segments_of(2048), beats=beats, mirror=True)
    frames = made.positions + torch.arange(0, 2048, 256)[:, None]
    assert set(frames.flatten().tolist()) <= set(beats)
    fixed = arrange(random_primitives(2), segments_of(2048), mirror=True)
    assert fixed.positions.tolist() == [[32, 64, 160, 192]] * 8
    mixed = arrange(
        random_primitives(2), segments_of(2048), beats=[300, 350, 400, 450], mirror=True
    )
    assert mixed.positions[:2].tolist() == [[32, 64, 160, 192], [44, 94, 144, 194]]


def test_beats_between_frames_are_refused():
    """Seconds times 30, cut off, put every cue of a local a beat too late."""
    primitives, segments = random_primitives(), segments_of(1024)
    whole = arrange(primitives, segments, beats=[8.0, 30.0, 60.0, 90.0], mirror=True)
    assert whole.positions[0].tolist() == [8, 30, 60, 90]
    with pytest.raises(ValueError, match=r"not 7\.76; .*dance_frames"):
        arrange(primitives, segments, beats=[7.76, 30.0, 60.0, 90.0], mirror=True)


@pytest.mark.parametrize("layout", [LAYOUT, DISCRETE, Layout(512, 128), Layout(1024, 512)])
@pytest.mark.parametrize("count", [2, 4])
def test_cues_never_touch_each_other_or_the_ends(layout, count):
    g = torch.Generator().manual_seed(1)
    n, span = layout.local_frames, layout.span
    for share in (0.0, 0.004, 0.01, 0.03, 0.1, 1.0):
        for _ in range(20):
            beats = (torch.rand(n, generator=g) < share).nonzero()[:, 0].tolist()
            at = cue_positions(beats, layout, count=count)
            assert len(at) == count
            gaps = torch.tensor([0, *at, n]).diff()
            assert gaps.min() >= span, (beats, at)


@pytest.mark.parametrize(
    "layout", [DISCRETE, Layout(512, 128), Layout(1024, 128), Layout(256, 128)]
)
def test_other_layouts_have_cues_too(layout):
    cues = make_cues(random_primitives(1, layout), segments_of(layout.global_frames, layout))
    assert cues.hard.sum(1).unique().tolist() == [8]
    assert cues.soft.sum(1).unique().tolist() == [32]
    n = layout.local_frames
    heads = [k * layout.stride for k in range(4)]
    assert cues.hard[0].nonzero()[:, 0].tolist() == heads + [
        n - (4 - k) * layout.stride for k in range(4)
    ]


def test_a_section_that_returns_gets_the_mirrored_cues():
    p, primitives = segments_of(2048), random_primitives(2)
    sections = [Section(0, 512, "a", 0), Section(512, 1024, "b", 0), Section(1024, 1536, "a", 1)]
    sections.append(Section(1536, 2048, "a", 2))
    made = arrange(primitives, p, mirror=True)
    plain, cues = made.cues(), repeat_sections(made, p, sections, mirror=True).cues()
    assert torch.equal(cues.value[:4], plain.value[:4])
    for j in range(2):
        for at in (32, 64, 160, 192):
            part = slice(at - 4, at + 4)
            assert torch.equal(cues.value[4 + j, part], mirrored(plain.value[j, part]))
            assert torch.equal(cues.value[6 + j, part], plain.value[j, part])  # third time
    assert torch.equal(cues.value[:, :4], plain.value[:, :4])  # hard cues stay
    once = arrange(primitives, p, mirror=False)
    unmirrored = repeat_sections(once, p, sections, mirror=False).cues()
    once = once.cues()
    assert torch.equal(unmirrored.value[4, 28:36], once.value[0, 28:36])


def test_what_returns_has_the_cues_of_its_first_time_wherever_that_began():
    p, primitives = segments_of(2048), random_primitives(2)
    sections = [Section(0, 512, "intro", 0), Section(512, 1024, "a", 0)]
    made = arrange(primitives, p, mirror=True)
    again = repeat_sections(made, p, [*sections, Section(1024, 1536, "a", 2)], mirror=True).soft
    assert torch.equal(again[4:6], made.soft[2:4])
    assert torch.equal(again[[0, 1, 2, 3, 6, 7]], made.soft[[0, 1, 2, 3, 6, 7]])


def test_cues_come_again_at_the_same_time_of_their_section():
    """Also where locals begin at other times of it; on a border, or on a cue that stays, none."""
    p = segments_of(1024)
    made = arrange(random_primitives(), p, mirror=True)  # cues at 32, 64, 160, 192 of each local
    sections = [Section(0, 300, "a", 0), Section(532, 840, "a", 2)]
    again = repeat_sections(made, p, sections, mirror=True)
    assert again.positions[2].tolist() == [52, 84, 180, 212]  # 532 - 512 later
    assert torch.equal(again.soft[2], made.soft[0])
    # from 768 to 840 there were two cues; that of 288 comes at 820, twice in one place
    assert again.positions[3].tolist() == [52, 52, 160, 192]
    assert torch.equal(again.soft[3, :2], made.soft[1, :1].expand(2, -1, -1))
    assert torch.equal(again.soft[3, 2:], made.soft[3, 2:])
    sections = [Section(0, 300, "a", 0), Section(704, 832, "a", 2)]  # 736, 768 (border), none else
    again = repeat_sections(made, p, sections, mirror=True)
    assert again.positions[2].tolist() == [32, 64, 160, 224]
    assert again.positions[3].tolist() == made.positions[3].tolist()
    sections = [Section(0, 300, "a", 0), Section(668, 830, "a", 2)]  # 828, beside the cue of 832
    again = repeat_sections(made, p, sections, mirror=True)
    assert again.positions[3].tolist() == made.positions[3].tolist()


def test_where_material_starts_again_no_cue_lies_on_another():
    made = arrange(random_primitives(), segments_of(1024), mirror=True)
    made = replace(made, positions=torch.tensor([[8, 64, 160, 192]] * 4))
    sections = [Section(4, 162, "a", 0), Section(200, 450, "a", 2)]
    again = repeat_sections(made, segments_of(1024), sections, mirror=True)
    # 156 after 200, not 162, which would be 6 frames later, and 218
    assert again.positions[1].tolist() == [100, 162, 100, 162]


def test_a_longer_return_starts_the_material_again_and_an_empty_section_gives_none():
    soft = random_primitives()[:, 1:3].flatten(0, 1)[None].repeat(4, 1, 1, 1)
    soft = soft + torch.arange(8.0).view(4, 2, 1, 1)
    positions = torch.tensor([[64, 192]] * 4)
    sections = [Section(0, 256, "a", 0), Section(256, 300, "b", 0), Section(300, 1024, "a", 2)]
    made = Arrangement(soft[:, 0, :4], soft, soft[:, 0, 4:], positions, LAYOUT)
    again = repeat_sections(made, segments_of(1024), sections, mirror=True)
    assert all(torch.equal(cues, soft[0]) for cues in again.soft)
    # 64 and 192 frames after 300, 556 and 812
    assert again.positions.tolist() == [[64, 192], [108, 236], [108, 236], [108, 236]]
    empty = [Section(0, 20, "a", 0), Section(20, 1024, "a", 1)]
    assert torch.equal(repeat_sections(made, segments_of(1024), empty, mirror=True).soft, soft)


def test_cues_for_the_network_are_scaled_and_not_cut():
    primitives = random_primitives()
    norm = Normalizer(torch.full((139,), -2.0), torch.full((139,), 6.0))
    cues = make_cues(primitives, segments_of(1024))
    scaled = cues.normalized(norm)
    cued = cues.hard | cues.soft
    assert torch.allclose(scaled.value[cued], (cues.value[cued] - 2) / 4, atol=1e-6)
    assert scaled.value[cued].min() < -1
    assert (scaled.value[~cued] == 0).all()


def test_cues_of_some_locals_are_those_of_all():
    whole = make_cues(random_primitives(2), segments_of(2048), beats=range(0, 2048, 14))
    arrangement = arrange(
        random_primitives(2), segments_of(2048), beats=range(0, 2048, 14), mirror=True
    )
    part = arrangement.cues(slice(3, 5))
    assert part.value.shape == (2, 256, 139) and part.hard.any() and part.soft.any()
    for name in ("value", "hard", "soft"):
        assert torch.equal(getattr(part, name), getattr(whole, name)[3:5]), name


def test_few_and_many_candidates():
    assert spread_evenly(range(0, 257, 10), 4, 0, 256, margin=8, apart=8) == [40, 100, 160, 220]
    assert spread_evenly([30, 200], 4, 0, 256, margin=8, apart=8) == [30, 72, 115, 200]
    assert spread_evenly([100, 103, 106, 109], 2, 0, 256, margin=8, apart=8) == [100, 109]
    assert spread_evenly([3, 253], 2, 0, 256, margin=8, apart=8) == [64, 192]  # all too close
