"""The floor, and bodies on it: leaps are left alone, floating is not."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.extensions.floor_contact import (
    GRAVITY,
    SMOOTH,
    flights,
    floor_contact_shift,
    project_floor_contact,
)
from dancediff.motion.contact import TOE_CLEARANCE
from dancediff.motion.representation import LODGE, TCDIFFPP, joints_of

HEIGHT = TCDIFFPP.root.start + 1


@pytest.fixture(scope="module")
def dance():
    """Five dancers who hop, (5, 300, 151)."""
    options = {"dancers": 5, "genre": "waacking", "seed": 3, "seconds": 10}
    return choreograph(np.arange(0.3, 10.5, 0.5), **options)[0].features()


@pytest.fixture(scope="module")
def level(dance):
    """The same without leaving the floor."""
    level = dance.clone()
    level[..., HEIGHT] -= lowest(dance)
    return level


def lowest(x):
    return joints_of(x)[..., 1].amin(-1) - TOE_CLEARANCE


@pytest.mark.parametrize("seconds", [0.2, 0.4, 0.8])
def test_a_thrown_body_flies(seconds):
    """The parabola of physics counts as a leap, a plateau for three times as long does not."""
    t = torch.linspace(0, seconds, round(30 * seconds) + 1)
    h = 0.5 * GRAVITY * t * (seconds - t)
    alone = torch.cat([torch.zeros(5), h, torch.zeros(5)])
    assert flights(alone).any()
    assert (flights(alone) == (alone > 0.02)).all()
    plateau = h.max().repeat(3 * len(t))
    assert not flights(torch.cat([torch.zeros(5), plateau, torch.zeros(5)])).any()


def test_rows_do_not_know_of_each_other():
    """Runs in the air end with their row."""
    h = torch.zeros(2, 3, 12)
    h[0, 1, 8:], h[0, 2, :4] = 0.04, 0.04
    assert flights(h).equal(h > 0.02)
    assert flights(torch.full((2, 12), 0.02).cumsum(0)).any().item() is False


def test_the_shift_minimises_its_equation():
    """The closed form against a general least-squares solver."""
    h = 0.3 * torch.rand(40, generator=torch.Generator().manual_seed(1))
    h[10:14] = torch.tensor([0.0, 0.06, 0.06, 0.0])
    weight = (~flights(h)).double()
    assert 0 < weight.sum() < 40
    D = torch.eye(40, dtype=torch.float64).diff(n=2, dim=0)
    A = torch.cat([torch.diag(weight), SMOOTH**0.5 * D])
    right = torch.cat([-weight * h, torch.zeros(38)])
    wanted = torch.linalg.lstsq(A, right[:, None].double()).solution[:, 0]
    assert torch.allclose(floor_contact_shift(h).double(), wanted, atol=1e-5)


def test_a_dance_on_the_floor_stays_as_it_is(dance):
    """With its leaps: there are some, and nothing moves by more than a centimetre."""
    moved = (project_floor_contact(dance) - dance).abs()
    assert flights(lowest(dance)).any()
    assert moved.max() < 0.01
    assert moved[..., HEIGHT].median() < 0.001


def test_who_floats_is_put_down(level):
    """Two seconds 20 cm above the floor; only the height of the root changes."""
    assert not flights(lowest(level)).any()
    high = level.clone()
    high[:, 60:120, HEIGHT] += 0.2
    down = project_floor_contact(high)
    assert (down[..., HEIGHT] - level[..., HEIGHT])[:, 70:110].abs().max() < 0.02
    others = [c for c in range(TCDIFFPP.dim) if c != HEIGHT]
    assert torch.equal(down[..., others], high[..., others])


def test_who_sank_is_lifted(level):
    low = level.clone()
    low[..., HEIGHT] -= 0.1
    assert lowest(project_floor_contact(low)).min() > -0.02


def test_known_heights_are_kept(level):
    """Held frames stay, and the frames beside them pass over smoothly."""
    high = level.clone()
    high[..., HEIGHT] += 0.1
    fixed = torch.zeros(high.shape[:-1], dtype=torch.bool)
    fixed[:, :100] = True
    down = project_floor_contact(high, fixed)
    assert torch.allclose(down[:, :100], high[:, :100], atol=1e-5)
    shift = (down - high)[..., HEIGHT]
    assert shift.diff(dim=1).abs().max() < 0.025
    assert (shift[:, 130:] + 0.1).abs().max() < 0.02


def test_lodges_vector_stands_like_the_other(dance):
    high = dance.clone()
    high[..., HEIGHT] += 0.1
    same = project_floor_contact(high)[..., : LODGE.dim]
    assert torch.equal(project_floor_contact(high[..., : LODGE.dim], spec=LODGE), same)
