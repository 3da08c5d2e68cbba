"""Decisions about Lodge's motion side, one test each: primitives, cues, seams.

Where the released code does something else, the test has it as a stand-in, to show that it would be
noticed. The numbers are those of the lines of docs/differences.md on Lodge.
"""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer.choreograph import choreograph
from dancediff.extensions.root_stitching import root_stitching
from dancediff.motion.beats import kinematic_energy, motion_beats
from dancediff.motion.contact import CONTACT_HEIGHT, foot_contact
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, Normalizer, joints_of, unpack
from dancediff.motion.skeleton import FOOT_JOINTS, SMPL24
from dancediff.papers.lodge.choreography import arrange
from dancediff.papers.lodge.cue_guidance import cue_channels
from dancediff.papers.lodge.primitives import DISCRETE, LAYOUT, primitive_frames, primitives_of
from dancediff.papers.lodge.segments import segments_of

FIXED = [32, 64, 160, 192]  # middles of 28:36, 60:68, 156:164, 188:196


@pytest.fixture(scope="module")
def clip():
    """34 seconds of a synthetic solo, (1024, 139)."""
    dance, _ = choreograph(np.arange(0.3, 36, 0.5), dancers=1, seed=1, seconds=35, genre="hiphop")
    return dance.features("lodge")[0, :1024]


@pytest.fixture(scope="module")
def normalizer(clip):
    return Normalizer.fit(clip)


def cues_of(clip, **options):
    return arrange(primitives_of(clip)[0][None], segments_of(1024), **{"mirror": True} | options)


def test_l02_soft_cues_are_on_beats(clip):
    """Released: at fixed frames, whatever the music does."""
    beats = list(range(9, 1024, 15))
    on_beats = cues_of(clip, beats=beats).positions + torch.arange(0, 1024, 256)[:, None]
    released = torch.tensor(FIXED) + torch.arange(0, 1024, 256)[:, None]
    assert np.isin(on_beats, beats).all()
    assert np.isin(released, beats).mean() < 0.5
    assert cues_of(clip).positions.tolist() == [FIXED] * 4  # no beats: the released frames


def test_l06_contacts_are_left_ankle_right_ankle_left_toe_right_toe():
    """Paper: left toe, left heel, right toe, right heel."""
    assert [SMPL24.names[j] for j in FOOT_JOINTS] == ["lankle", "rankle", "ltoe", "rtoe"]
    joints = torch.full((4, 24, 3), 1.0)
    for k, j in enumerate(FOOT_JOINTS):
        down = joints.clone()
        down[:, j, 1] = 0
        assert foot_contact(down)[0].nonzero().flatten().tolist() == [k]
    assert LODGE.contact == slice(0, 4)


def test_l07_contact_is_low_and_does_not_travel():
    """Released: low is enough, so that a foot that skates is called planted."""
    assert CONTACT_HEIGHT == (0.12, 0.12, 0.05, 0.05)
    joints = torch.zeros(5, 24, 3)
    skates = joints + torch.arange(5.0)[:, None, None] * torch.tensor([0.05, 0, 0])
    released = skates[:, FOOT_JOINTS, 1] <= torch.tensor(CONTACT_HEIGHT)
    assert released.all() and foot_contact(joints).all() and not foot_contact(skates).any()


def test_l13_thirteen_primitives_in_training_as_in_dancing(clip):
    """Released: trained on 25 (locals of 128), dances with 13."""
    trained = primitives_of(clip)[0]
    assert len(trained) == LAYOUT.num_primitives == 13
    cues_of(clip)  # what training makes is what dancing takes
    released_in_training = 3 * 1024 // 128 + 1
    assert released_in_training == 25
    with pytest.raises(ValueError, match="these segments need"):
        arrange(torch.zeros(1, released_in_training, 8, 139), segments_of(1024), mirror=True)


def test_l14_hard_primitives_lie_across_the_borders(clip):
    """Released: at multiples of 128 k / K, so that none is where locals meet."""
    hard = primitives_of(clip)[1][::3]
    borders = torch.arange(0, 1025, 256)
    assert hard[1:-1, 4].tolist() == borders[1:-1].tolist()
    assert hard[0, 0] == 0 and hard[-1, -1] == 1023
    released = [round(128 * k / 4) for k in range(1, 4)]
    assert not set(released) & set(borders.tolist())


def test_l15_key_motions_are_found_on_the_body_in_metres(clip, normalizer):
    """Released: on normalised vectors, whose root has no metres."""
    joints = joints_of(clip, LODGE)
    ours, energy = motion_beats(joints), kinematic_energy(joints)
    released = motion_beats(joints_of(normalizer.normalize(clip), LODGE))
    frames = primitives_of(clip)[1]
    assert torch.equal(frames, primitive_frames(ours, energy=energy))
    assert not torch.equal(frames, primitive_frames(released, energy=energy))


def test_l16_two_soft_primitives_in_each_local(clip):
    """Paper: 8, and 21 in its appendix. Released: 8, as they fall in the clip."""
    middles = primitives_of(clip)[1][:, 4]
    soft = torch.stack([middles[1::3], middles[2::3]], dim=1)
    assert (soft // 256 == torch.arange(4)[:, None]).all()
    crowded = [30, 60, 90, 120, 150, 180, 210, 230]  # all rests in the first quarter
    middles = primitive_frames(crowded)[:, 4]
    assert (torch.stack([middles[1::3], middles[2::3]], 1) // 256).tolist() == [
        [j, j] for j in range(4)
    ]
    assert cues_of(clip).positions.numel() == 16  # each is danced twice


def test_l18_the_root_is_never_constrained(clip):
    """Paper: all channels. Ours, as released: contacts and rotations; the root is stitched."""
    channels = cue_channels()
    assert (~channels).nonzero().flatten().tolist() == [4, 5, 6]


def test_l19_no_jump_where_locals_meet(clip):
    """Released: locals are put side by side, each near the middle of the stage."""
    locals_ = torch.stack(
        [part - torch.nn.functional.pad(part[0, 4:7] * torch.tensor([1.0, 0, 1]), (4, 132))
         for part in clip.split(256)]
    )  # fmt: skip
    seams = [256, 512, 768]
    step = clip[:, [4, 6]].diff(dim=0).norm(dim=1)
    released = locals_.flatten(0, 1)[:, [4, 6]].diff(dim=0).norm(dim=1)[[s - 1 for s in seams]]
    dance = root_stitching(locals_)
    mended = dance[:, [4, 6]].diff(dim=0).norm(dim=1)[[s - 1 for s in seams]]
    assert released.max() > 0.12 > 3 * step.max() / 2
    assert mended.max() <= step.max()
    # the dance that was cut is the dance that comes back
    assert (dance[:, [4, 6]] - clip[:, [4, 6]] + clip[0, [4, 6]]).norm(dim=1).max() < 0.05


def test_a_clip_is_not_damaged_by_taking_its_primitives(clip):
    """Released: the root is moved in slices of the clip itself."""

    def released(x):
        pieces = [x[k * 256 : k * 256 + 8] for k in range(4)]
        for piece in pieces:
            piece[:, [4, 6]] -= piece[:1, [4, 6]].clone()
        return pieces

    x = clip.clone()
    primitives_of(x)[0].zero_()
    assert torch.equal(x, clip)
    released(x)
    assert not torch.equal(x, clip)


def test_cues_are_mirrored_in_metres(clip, normalizer):
    """Released: normalised vectors are mirrored, as if every range were symmetric."""
    primitives = primitives_of(clip)[0]
    made = arrange(primitives[None], segments_of(1024), mirror=True)
    cues, at = made.cues().normalized(normalizer), int(made.positions[0, 1])
    ours = normalizer.unnormalize(cues.value[0, at - 4 : at + 4])
    released = normalizer.unnormalize(mirror_features(normalizer.normalize(primitives[1]), LODGE))
    truth = joints_of(mirror_features(primitives[1], LODGE), LODGE)
    wrong = [(joints_of(x, LODGE) - truth).norm(dim=-1).max() for x in (ours, released)]
    assert wrong[0] < 1e-4 and wrong[1] > 0.05
    _, _, pose = unpack(ours, LODGE)
    assert (pose.det() - 1).abs().max() < 1e-4


def test_songs_of_any_length_are_danced_to_their_end():
    """Released: what is left after the last 256 frames is dropped, songs under 1024 refused."""
    for frames in (40, 700, 1100, 2047):
        p = segments_of(frames)
        x = root_stitching(torch.zeros(len(p.locals), 256, 139))[: p.frames]
        assert len(x) == frames and frames // 256 < len(p.locals)
        arrange(torch.zeros(len(p.globals), 13, 8, 139), p, mirror=True)


def test_discrete_primitives_have_as_many_frames_further_apart(clip):
    """Paper (table 6): the dance thinned four times, lacking velocities."""
    (dense, near), (thin, far) = primitives_of(clip), primitives_of(clip, layout=DISCRETE)
    assert dense.shape == thin.shape
    assert (near.diff(dim=1) == 1).all() and (far.diff(dim=1) == 4).all()
    p = segments_of(1024, DISCRETE)
    cues = arrange(thin[None], p, mirror=True).cues()
    assert cues.soft.sum() == cues_of(clip).cues().soft.sum()
    assert cues.hard[0, :13:4].all() and not cues.hard[0, 1:4].any()
