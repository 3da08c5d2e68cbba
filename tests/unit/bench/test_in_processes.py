"""Calls in processes: in order, each in one thread, which afterwards are as many as before."""

import joblib
import torch

from dancediff.bench.in_processes import in_processes


def threads(k: int, *, more: int) -> tuple[int, int]:
    return k + more, torch.get_num_threads()


def test_each_call_has_one_thread_and_its_place():
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        calls = (joblib.delayed(threads)(k, more=1) for k in (3, 1, 2))
        assert in_processes(calls, workers=1) == [(4, 1), (2, 1), (3, 1)]
        assert torch.get_num_threads() == 2
    finally:
        torch.set_num_threads(before)


def test_nothing_to_do_is_done():
    assert in_processes([], workers=2) == []
