from itertools import permutations

import numpy as np
import pytest
import torch

from dancediff.papers.tcdiffpp.swap_mode import (
    SwapModeEmbedding,
    check_order,
    left_to_right,
    swap_mode,
)


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


def test_every_order_has_its_own_embedding():
    torch.manual_seed(0)
    embed = SwapModeEmbedding(5, 16)
    vectors = embed(torch.tensor(list(permutations(range(4)))))
    assert torch.pdist(vectors).min() > 1e-3


def test_absent_dancers_do_not_count():
    embed = SwapModeEmbedding(5, 16)
    padded = torch.tensor([[1, 0, 2, 3, 4]])
    present = torch.tensor([[True, True, True, False, False]])
    torch.testing.assert_close(embed(padded, present), embed(padded[:, :3]))
