"""The packaged Lodge's dances: what a viewer would notice first, without any post-processing.

One dance of 34 s to the packaged song played twice: four locals, three seams.
"""

import pytest
import torch

import dancediff as dd
from dancediff.data.choreographed import choreograph_jobs
from dancediff.motion.contact import feet_low, foot_speed
from dancediff.motion.mirror import mirror_features
from dancediff.motion.motion import Motion
from dancediff.motion.representation import LODGE, with_hands
from dancediff.music.features import dance_frames
from dancediff.music.synth import synth_song
from dancediff.papers.lodge.choreography import arrange
from dancediff.papers.lodge.segments import segments_of

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def model():
    return dd.load("lodge")


@pytest.fixture(scope="module")
def song():
    return synth_song(2_000_001, seconds=36.0)[0]


@pytest.fixture(scope="module")
def dance(model, song):
    return model.generate(song, seconds=34, seed=1, genre="hiphop")


def speed(dance):
    """Mean over joints and frames, m/s."""
    return 30 * dance.joints().diff(dim=1).norm(dim=-1).mean().item()


def test_bodies_stay_between_floor_and_reach(dance):
    height = dance.joints()[..., 1]
    assert height.isfinite().all()
    assert height.min() > -0.08 and height.max() < 2.4


def test_no_root_jumps_not_even_at_seams(dance):
    assert dance.meta["seams"] == [256, 512, 768]
    assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.12


def test_nobody_walks_off(dance):
    assert dance.root[..., (0, 2)].norm(dim=-1).max() < 4.0


def test_feet_stand(dance):
    joints = dance.joints()
    low = feet_low(joints)
    assert (foot_speed(joints)[low] < 0.015).float().mean() > 0.8


def test_it_moves_as_much_as_the_dances_it_learned_from(dance):
    jobs = choreograph_jobs(10, seconds=20.0, sizes=(1,))  # one of each genre
    learned = [speed(job.make().motion) for job in jobs]
    assert speed(dance) == pytest.approx(sum(learned) / 10, rel=0.4)


def test_a_soft_cue_and_its_mirror_image_are_danced(model, song):
    """Mirrored back, the second is like the first where cues lie, and nowhere else."""

    def apart(soft, shift=0):
        made = model.generate(song, seconds=8, seed=1, genre="hiphop", soft=soft)
        segments, primitives = segments_of(256), torch.zeros(1, 13, 8, LODGE.dim)
        beats = dance_frames(song.features())
        spots = arrange(primitives, segments, beats=beats, mirror=True).positions[0]
        cues = made.features("lodge")[0][shift + spots[:, None] + torch.arange(-4, 4)]
        cues[1::2] = mirror_features(cues[1::2], LODGE)
        joints = Motion.from_features(with_hands(cues)).joints()
        joints = joints - joints[:, :, :1]
        return (joints[::2] - joints[1::2]).norm(dim=-1).mean().item()

    assert apart(1.0) < 0.4 * apart(0.0)
    assert apart(1.0) < 0.4 * apart(1.0, shift=-15)


def test_another_seed_and_another_genre_are_other_dances(model, song):
    short = {"seconds": 8, "steps": 6, "seed": 0, "genre": "hiphop"}
    one = model.generate(song, **short)
    again = model.generate(song, **short)
    assert torch.equal(one.root, again.root)
    for change in ({"seed": 1}, {"genre": "salsa"}):
        other = model.generate(song, **short | change)
        assert (other.joints() - one.joints()).norm(dim=-1).mean() > 0.05


def test_indian_dance_is_as_lively_as_the_captured_one(model, song, dance):
    """Once a dance that was asked to be Indian was the choreographer's, at half the speed."""
    indian = model.generate(song, seconds=17, seed=1, genre="indian")
    assert speed(indian) > 1.5 * speed(dance)


def test_knows_the_genres_it_names(model):
    assert list(model.config.genres) == dd.genres()
