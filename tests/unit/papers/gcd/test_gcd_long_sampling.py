"""Long dances of GCD: dancers of segments find each other, overlaps are blended."""

import torch

from dancediff.motion.representation import Normalizer, unpack
from dancediff.papers.gcd.long_sampling import MatchedOverlaps, in_one_order, matched

NORMALIZER = Normalizer(-2 * torch.ones(151), 2 * torch.ones(151))


def segments(k=3, n=3, f=12):
    x = torch.rand(k, n, f, 151) - 0.5
    x += 2 * torch.arange(n)[:, None, None]  # dancers who are far from each other
    return x


def test_matching_undoes_a_permutation_even_of_noisy_dancers():
    x = segments(1)[0]
    for order in ([0, 1, 2], [2, 0, 1], [1, 0, 2]):
        found = matched(x, (x + 0.1 * torch.randn_like(x))[order])
        assert torch.tensor(order)[found].tolist() == [0, 1, 2]


def test_segments_get_the_order_of_the_first():
    x = segments()
    mixed = torch.stack([x[0], x[1][[2, 0, 1]], x[2][[1, 2, 0]]])
    assert torch.equal(in_one_order(mixed, overlap=6), x)


def test_overlaps_agree_afterwards_and_go_from_one_to_the_other():
    x = segments()
    mixed = torch.stack([x[0], x[1][[2, 0, 1]], x[2]])
    made = MatchedOverlaps(6, NORMALIZER).apply(mixed, abar=0.5)
    found = in_one_order(made, overlap=6)
    for i in range(2):
        assert torch.allclose(found[i, :, -6:], found[i + 1, :, :6], atol=1e-5)
    roots = [unpack(NORMALIZER.unnormalize(one))[1] for one in (found[0], x[0], x[1])]
    assert torch.allclose(roots[0][:, 6], roots[1][:, 6], atol=1e-5)  # w = 0
    assert torch.allclose(roots[0][:, 11], roots[2][:, 5], atol=1e-5)  # w = 1
    assert torch.equal(found[0, :, :6], x[0, :, :6])  # outside overlaps nothing changes


def test_one_segment_is_left_alone():
    x = segments(1)
    assert torch.equal(MatchedOverlaps(6, NORMALIZER).apply(x, abar=0.5), x)
