"""Batches made ahead by other processes are those that the sampler makes itself."""

import pytest
import torch

from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.training.prefetch import Prefetched


def sampler() -> WindowSampler:
    g = torch.Generator().manual_seed(0)
    takes = [
        DanceTake(f"{n}", torch.rand(n, 90, 151, generator=g), M=torch.rand(90, 35, generator=g))
        for n in (1, 2, 3)
    ]
    return WindowSampler(takes, GroupCut(40), dancers_per_batch=6, seed=4)


def same(a, b) -> bool:
    return all(x is y is None or torch.equal(x, y) for x, y in zip(a, b, strict=True))


@pytest.mark.filterwarnings("ignore:This DataLoader will create")  # on one core
def test_two_processes_make_the_same_batches_in_order():
    data = sampler()
    ahead = Prefetched(data, workers=2)
    for number in (*range(3, 9), 20, 21, 4):  # a row, another row, and back
        assert same(ahead.batch(number), data.batch(number)), number


def test_a_row_is_made_by_one_start_of_the_workers():
    ahead = Prefetched(sampler(), workers=0)
    starts = []
    begin = ahead._from
    ahead._from = lambda number: starts.append(number) or begin(number)
    for number in (5, 6, 7, 2, 3):
        ahead.batch(number)
    assert starts == [5, 2]
