from itertools import permutations

import torch

from dancediff.papers.tcdiffpp.group_dance_decoder import SwapModeEmbedding


def test_it_is_its_equation():
    """One vector for each place and the dancer who ends there, not for each dancer and place."""
    embed = SwapModeEmbedding(5, 16)
    ends = embed.table[0, 1] + embed.table[1, 2] + embed.table[2, 0]
    torch.testing.assert_close(embed(torch.tensor([[1, 2, 0]]))[0], embed.mlp(ends))


def test_every_order_has_its_own_embedding():
    torch.manual_seed(0)
    embed = SwapModeEmbedding(5, 16)
    vectors = embed(torch.tensor(list(permutations(range(4)))))
    assert torch.pdist(vectors).min() > 1e-3
