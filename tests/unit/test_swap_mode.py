from itertools import permutations

import torch

from dancediff.papers.tcdiffpp.swap_mode import SwapModeEmbedding


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
