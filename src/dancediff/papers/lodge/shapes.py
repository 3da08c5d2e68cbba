"""Shapes of what a network is given."""

from torch import Tensor


def check_shapes(**values: tuple[Tensor | None, tuple | None]) -> None:
    """Each value with the shape it should have; None: it should not be given.

    Raises: ValueError naming the argument.

    >>> import torch
    >>> check_shapes(t=(torch.zeros(3), (2,)))
    Traceback (most recent call last):
    ValueError: t has shape (3,); expected (2,)
    """
    for name, (value, expected) in values.items():
        have = None if value is None else tuple(value.shape)
        if have != expected:
            raise ValueError(f"{name} has shape {have}; expected {expected}")
