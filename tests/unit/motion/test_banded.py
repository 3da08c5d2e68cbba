"""Banded systems against dense ones, and with a number of threads that was set by hand."""

import numpy as np
import pytest
import torch

from dancediff.motion.banded import bends, dense, nearness, solve_banded, solve_banded_ref, steps


@pytest.mark.parametrize("f", [1, 2, 3, 4, 9])
def test_bands_are_those_of_the_sums_of_squares(f):
    w, v = torch.rand(2, f, dtype=torch.float64), torch.rand(2, max(f - 1, 0), dtype=torch.float64)
    D = torch.eye(f, dtype=torch.float64).diff(dim=0)
    torch.testing.assert_close(dense(nearness(w)), torch.diag_embed(w))
    torch.testing.assert_close(dense(steps(v)), D.mT @ (v[..., None] * D))
    second = torch.eye(f, dtype=torch.float64).diff(n=2, dim=0)
    torch.testing.assert_close(dense(bends(f)), second.mT @ second)


@pytest.mark.parametrize("heavy", [1.0, 1e8])
def test_the_solution_is_that_of_the_dense_system(heavy):
    draw = torch.Generator().manual_seed(0)
    w = torch.rand(4, 3, 150, generator=draw, dtype=torch.float64) + 1e-6
    w[..., 20:30] = heavy
    bands = nearness(w) + steps(w[..., 1:]) + 100 * bends(150)
    b = torch.randn(4, 3, 150, 2, generator=draw, dtype=torch.float64)
    torch.testing.assert_close(
        solve_banded(bands, b), solve_banded_ref(bands, b), rtol=1e-7, atol=1e-9
    )


def test_what_is_not_finite_stays_in_its_own_system():
    bands = nearness(torch.ones(2, 5)).double()
    bands[0, 0, 2] = torch.nan
    x = solve_banded(bands, torch.ones(2, 5, 1))
    assert x[0].isnan().all() and (x[1] == 1).all() and x.dtype == torch.float32
    with pytest.raises(np.linalg.LinAlgError):
        solve_banded(nearness(-torch.ones(1, 5)), torch.ones(1, 5, 1))
