"""Which digits are computed with: what was asked for, or what is faster here."""

import pytest
import torch

from dancediff.nn import precision
from dancediff.nn.precision import chosen_dtype, fastest_dtype


@pytest.mark.parametrize(
    ("name", "dtype"), [(None, None), ("float32", torch.float32), ("bfloat16", torch.bfloat16)]
)
def test_named_dtypes_are_taken(name, dtype):
    assert chosen_dtype(name, "cpu") == dtype


@pytest.mark.parametrize(
    ("full", "half", "faster"),
    [(1.0, 0.5, torch.bfloat16), (1.0, 2.0, torch.float32), (1.0, 0.95, torch.float32)],
)
def test_half_the_digits_must_be_worth_it(monkeypatch, full, half, faster):
    took = {torch.float32: full, torch.bfloat16: half}
    monkeypatch.setattr(precision, "_seconds", lambda kind, dtype: took[dtype])
    fastest_dtype.cache_clear()
    assert chosen_dtype("fastest", "cpu") == faster
    fastest_dtype.cache_clear()


def test_the_probe_measures_both_once(monkeypatch):
    measured, real = [], precision._seconds
    monkeypatch.setattr(
        precision, "_seconds", lambda kind, dtype: measured.append(dtype) or real(kind, dtype)
    )
    fastest_dtype.cache_clear()
    assert chosen_dtype("fastest", "cpu") == chosen_dtype("fastest", torch.device("cpu"))
    assert measured == [torch.float32, torch.bfloat16]
