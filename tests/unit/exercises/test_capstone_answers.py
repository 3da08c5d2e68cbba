"""What lesson 16 builds on must train: an answer that is right may have no gradient."""

import pytest
import torch

from dancediff import nb
from dancediff.exercises.solutions import solution_text


def solution():
    space: dict = {}
    exec(solution_text("16.2"), space)
    return space["ssd"]


@pytest.mark.parametrize("find", [solution, lambda: nb.answer("16.2")], ids=["solution", "course"])
def test_the_memory_has_a_gradient_where_everything_is_forgotten(find):
    draw = torch.Generator().manual_seed(0)
    u, B, C = (torch.randn(1, 90, width, generator=draw) for width in (4, 8, 8))
    a = torch.full((1, 90), -3.0, requires_grad=True)  # exp(-3 * 89) cannot be told from 0
    find()(u, a, B, C).square().sum().backward()
    assert a.grad.isfinite().all() and a.grad.abs().max() > 0
