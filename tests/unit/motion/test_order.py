"""Order from left to right and swap mode: right, and the same wherever they are used."""

from itertools import permutations

import numpy as np
import pytest
import torch

from dancediff.data.windows import rank_left_to_right
from dancediff.metrics.swaps import final_order
from dancediff.motion.order import check_order, left_to_right, relative_order, swap_mode
from dancediff.motion.representation import TCDIFFPP


def test_nobody_swaps():
    x = torch.randn(4, 5)
    assert torch.equal(swap_mode(x, x + 3), torch.arange(5).expand(4, 5))


@pytest.mark.parametrize("wanted", list(permutations(range(4))))
def test_swap_mode_is_what_was_danced(wanted):
    """Dancers ranked 0..3 at the start walk so that wanted[k] ends k-th from the left."""
    x_first, x_last = torch.arange(4.0), torch.empty(4)
    for place, dancer in enumerate(wanted):
        x_last[dancer] = place
    assert swap_mode(x_first, x_last).tolist() == list(wanted)


def test_does_not_depend_on_who_is_called_what():
    x_first, x_last, names = torch.randn(3, 5), torch.randn(3, 5), torch.randperm(5)
    renamed = swap_mode(x_first[:, names], x_last[:, names])
    assert torch.equal(renamed, swap_mode(x_first, x_last))


def test_ties_keep_their_order():
    assert left_to_right(torch.zeros(6)).tolist() == list(range(6))


@pytest.mark.parametrize("bad", [[0, 1], [0, 1, 1], [1, 2, 3], [0, 1, 2.5], "012", [0, 1, -1]])
def test_no_permutation_is_named(bad):
    with pytest.raises(ValueError, match=r"swap=.* must hold each of 0\.\.2 exactly once"):
        check_order(bad, 3)


def test_order_may_be_a_tensor_a_tuple_or_an_array():
    for order in (torch.tensor([1, 0]), (1, 0), np.array([1, 0])):
        assert check_order(order, 2).tolist() == [1, 0]


def test_relative_order():
    for _ in range(20):
        order, target = torch.randperm(5), torch.randperm(5)
        assert torch.equal(order[relative_order(target, order)], target)


@pytest.mark.parametrize("seed", range(20))
def test_training_sampling_and_metrics_agree(seed):
    """Eq. 5 to 7 of the same random walk as each of them computes it."""
    g = torch.Generator().manual_seed(seed)
    n = 2 + seed % 4
    x = torch.zeros(n, 40, TCDIFFPP.dim)
    x[..., TCDIFFPP.root] = (0.3 * torch.randn(n, 40, 3, generator=g)).cumsum(1)
    lateral = x[..., TCDIFFPP.root.start]
    ranked, S = rank_left_to_right(x)  # of a training window
    assert (ranked[:, 0, TCDIFFPP.root.start].diff() >= 0).all()
    assert tuple(S.tolist()) == final_order(x[..., TCDIFFPP.root])  # of the metric
    begin, end = left_to_right(lateral[:, 0]), left_to_right(lateral[:, -1])
    assert torch.equal(relative_order(end, begin), S)  # of a segment of a long dance
    assert torch.equal(swap_mode(lateral[:, 0], lateral[:, -1]), S)
