"""Foot contact in dances of the packaged model: feet slide less, and what was asked for is kept."""

import pytest
import torch

import dancediff as dd
from dancediff.extensions.control import Keep
from dancediff.extensions.foot_contact_projection import project_foot_contact
from dancediff.metrics.physical import fsr
from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import FOOT_JOINTS

KNEE = TCDIFFPP.joint_channels([dd.motion.skeleton.SMPL24.index("lknee")])


@pytest.fixture(scope="module")
def dance_with():
    model, song = dd.load("tcdiffpp"), dd.packaged_song()
    return lambda **more: model.generate(
        song, **{"dancers": 2, "seconds": 5, "steps": 8, "seed": 3} | more
    )


def test_dances_slide_less_with_planted_feet(dance_with):
    """As little as held-out dances, whose FSR is 0.024 to 0.029 (docs/results_tcdiffpp.md)."""
    free, planted = (dance_with(foot_contact=on) for on in (False, True))
    assert planted.meta["foot_contact"] and not free.meta["foot_contact"]
    assert fsr(planted.joints()) < 0.8 * fsr(free.joints())
    assert fsr(planted.joints()) < 0.03


def test_it_is_no_work_on_the_finished_dance(dance_with):
    """Projecting the finished dance is not the same: the network answers to the projection."""
    free, planted = (dance_with(foot_contact=on) for on in (False, True))
    afterwards = project_foot_contact(free.features())
    assert (afterwards[..., TCDIFFPP.root] - planted.root).abs().max() > 0.005


def test_legs_that_were_asked_for_are_kept(dance_with):
    other = dance_with(seed=9)
    kept = dance_with(constraints=[Keep(other, joints="lower body")])
    assert (kept.features()[..., KNEE] - other.features()[..., KNEE]).abs().max() < 1e-3


def test_planted_feet_do_not_move_at_a_seam():
    """Known frames are held, so that a long dance takes over where the segment before ended."""
    jumps = []
    for seed in range(1, 9):  # the median of four dances varies by a quarter
        ask = {"dancers": 2, "seconds": 10, "steps": 8, "seed": seed}
        dance = dd.load("tcdiffpp").generate(dd.packaged_song(), **ask)
        step = 100 * dance.joints()[:, :, FOOT_JOINTS].diff(dim=1).norm(dim=-1)
        stands = dance.features()[:, :-1, TCDIFFPP.contact] > 0.5
        seams = [seam - 1 for seam in dance.meta["seams"] if seam < dance.num_frames]
        jumps.append(step[:, seams][stands[:, seams]])
    jump = torch.cat(jumps)
    assert len(jump) > 30 and jump.median() < 0.2
    assert (jump > 1.5).float().mean() < 0.1  # of some that stand the next step begins there


def test_it_is_on_or_off(dance_with):
    with pytest.raises(ValueError, match="foot_contact='glued' must be True or False"):
        dance_with(foot_contact="glued")
