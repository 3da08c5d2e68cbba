"""Counting how often rules change guesses: what counts, and that dances stay the same."""

import sys

import torch

from dancediff.extensions.constraint import Constraint, ConstraintHook
from dancediff.extensions.projection import Projection
from dancediff.motion.representation import Normalizer
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from rule_shares import Counted, changed

one = torch.ones(151)
NORMALIZER = Normalizer(-one, one)


def upright(dancers=2, frames=8):
    row = torch.cat([torch.zeros(7), torch.eye(3)[:2].flatten().repeat(24)])
    return row.expand(1, dancers, frames, 151).clone()


def test_a_frame_counts_when_a_joint_is_a_centimetre_away_or_turned_by_three_degrees():
    x = upright()
    for centimetres, share in ((0.9, 0.0), (1.1, 0.25)):
        moved = x.clone()
        moved[:, 0, :4, 5] += centimetres / 100
        assert changed(x, moved) == share
    for degrees, share in ((2.9, 0.0), (3.1, 0.5)):  # the head, which moves no joint
        turned, angle = x.clone(), torch.tensor(degrees).deg2rad()
        head = 7 + 6 * 15
        c, s = angle.cos(), angle.sin()
        turned[:, 1, :, head : head + 6] = torch.stack([c, -s, 0 * c, s, c, 0 * c])
        assert changed(x, turned) == share


def sink(x, fixed):
    """A step that lowers everybody by 5 cm."""
    x = x.clone()
    x[..., 5] -= 0.05
    return x


def still(x, fixed):
    """A step that does nothing."""
    return x


def test_each_rule_is_counted_for_itself_and_dances_stay_the_same():
    x = upright()
    hook = Projection(NORMALIZER, [sink, still])
    mask = torch.zeros(2, 8, 151, dtype=torch.bool)
    mask[:, 0, 4] = True
    held = ConstraintHook(torch.full((8, 151), 0.1), [Constraint(mask, upright()[0] + 0.2)])
    expected = [hook.apply(x, 0.4), hook.apply(x, 0.9), held.apply(x, 0.4)]
    counted = Counted(NORMALIZER)
    with counted.watching():
        made = [hook.apply(x, 0.4), hook.apply(x, 0.9), held.apply(x, 0.4)]
    assert all(torch.equal(a, b) for a, b in zip(made, expected, strict=True))
    assert counted.all["sink"] == [1.0] and counted.all["still"] == [0.0]
    assert counted.all["initial_frames"][0] > 0
    assert set(counted.last) == {"sink", "still"}, "the constraint saw no guess with as much signal"
