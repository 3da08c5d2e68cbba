import torch

from dancediff.papers.tcdiffpp.group_dance_decoder import DancerPositioning


def test_same_rank_same_code_in_every_frame_and_group_size():
    dpe = DancerPositioning(5, 8)
    codes = dpe(torch.zeros(2, 4, 7, 8))
    assert torch.equal(codes[:, :, 0], codes[:, :, 6])
    assert torch.equal(codes[0, :3], dpe(torch.zeros(1, 3, 7, 8))[0])


def test_ranks_differ():
    assert torch.pdist(DancerPositioning(5, 64).table).min() > 0.5
