"""benchmarks/lodge_minutes.py: variety, coming back and facing, of dances with known answers."""

import sys

import pytest
import torch

from dancediff.data.choreographer import choreograph
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import lodge_minutes


@pytest.fixture(scope="module")
def joints():
    dance, _ = choreograph([k / 2 for k in range(80)], dancers=1, seed=3, seconds=40)
    return dance.joints()


def test_one_window_again_and_again_is_not_varied(joints):
    again = joints[:, :150].repeat(1, 8, 1, 1)
    reference = lodge_minutes.described(joints)
    name, k, g, _ = lodge_minutes.row("again", [again, again], reference)
    assert name == "again" and k[0] < 1e-6 and g[0] < 1e-6
    _, k, g, _ = lodge_minutes.row("dance", [joints, joints], reference)
    assert k[0] > 1 and g[0] > 1 and k[1] <= k[0] <= k[2]


def test_who_walks_away_does_not_come_back(joints):
    stays = joints[:, :1].expand(-1, 1024, -1, -1).clone()
    assert lodge_minutes.comes_back(stays) == 1
    stays[0, 512:, :, 0] += 1  # from the third of four segments on a metre away
    assert lodge_minutes.comes_back(stays) == 0.5


def test_a_turned_dancer_does_not_face_the_audience(joints):
    front = lodge_minutes.faces_front(joints)
    x, y, z = joints.unbind(-1)
    assert lodge_minutes.faces_front(torch.stack([-x, y, -z], -1)) < 1 - front + 0.1
    turned = torch.stack([z, y, -x], -1)  # a quarter to the side
    assert front > 0.8 > 0.2 > lodge_minutes.faces_front(turned)
