"""Unison: do the dancers of a group do the same at the same time?"""

import math

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.metrics.report import evaluate
from dancediff.metrics.unison import unison


@pytest.fixture(scope="module")
def trio():
    dance, _ = choreograph(np.arange(0.2, 20, 0.5), dancers=3, seed=5, seconds=20)
    return dance


@pytest.fixture(scope="module")
def solo(trio):
    return trio.joints()[:1]


def test_copies_are_in_unison_wherever_they_stand_and_travel(solo):
    there = torch.randn(4, solo.shape[1], 1, 3, generator=torch.Generator().manual_seed(0))
    assert unison(solo.expand(4, -1, -1, -1) + there.cumsum(1)) == pytest.approx(1.0, abs=1e-4)


def test_size_and_rate_do_not_matter(solo):
    pair = torch.cat([solo, 0.5 * solo])
    assert unison(pair) == pytest.approx(1.0, abs=1e-4)
    assert unison(pair, fps=60.0) == pytest.approx(unison(pair))


def test_opposites_are_the_opposite(solo):
    assert unison(torch.cat([solo, -solo])) == pytest.approx(-1.0, abs=1e-4)


def test_dancers_of_other_dances_are_strangers():
    beats = np.arange(0.2, 20, 0.5)
    other = [choreograph(beats, dancers=1, seed=s, seconds=20)[0].joints() for s in range(6)]
    assert abs(unison(torch.cat(other))) < 0.1


def test_the_slow_loop_says_the_same(trio):
    J, found = trio.joints()[:, :60], []
    for d in range(3):
        for e in range(d + 1, 3):
            both = own = others = 0.0
            for i in range(59):
                a = (J[d, i + 1] - J[d, i + 1, 0]) - (J[d, i] - J[d, i, 0])
                b = (J[e, i + 1] - J[e, i + 1, 0]) - (J[e, i] - J[e, i, 0])
                both += float((a * b).sum())
                own, others = own + float((a * a).sum()), others + float((b * b).sum())
            found.append(both / math.sqrt(own * others))
    assert unison(J) == pytest.approx(np.mean(found), abs=1e-4)


def test_the_later_a_dancer_is_the_less(solo):
    values = [unison(torch.cat([solo[:, k:][:, :500], solo[:, :500]])) for k in (0, 2, 4, 8)]
    assert values == sorted(values, reverse=True) and values[-1] < 0.5


def test_who_does_nothing_is_in_unison_with_nobody(solo):
    still = solo[:, :1].expand(-1, solo.shape[1], -1, -1)
    assert unison(torch.cat([solo, still])) == 0.0
    assert unison(torch.cat([solo, solo, still])) == pytest.approx(1 / 3, abs=1e-4)


def test_shaking_breaks_it(trio):
    J = trio.joints()
    shaken = J + 0.02 * torch.randn(J.shape, generator=torch.Generator().manual_seed(1))
    assert unison(shaken) < 0.7 * unison(J)


def test_it_is_a_row_of_the_report(trio):
    row = evaluate(trio)["unison"]
    assert row.value == pytest.approx(unison(trio.joints())) and row.arrow == "reference"


def test_one_dancer_is_no_group(solo):
    with pytest.raises(ValueError, match="needs 2 or more"):
        unison(solo)
