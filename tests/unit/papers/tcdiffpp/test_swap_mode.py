from itertools import permutations

import torch

from dancediff.papers.tcdiffpp.group_dance_decoder import SwapModeEmbedding


def test_every_order_has_its_own_embedding():
    torch.manual_seed(0)
    embed = SwapModeEmbedding(5, 16)
    vectors = embed(torch.tensor(list(permutations(range(4)))))
    assert torch.pdist(vectors).min() > 1e-3
