"""A critic that tells others how to learn, and does not learn from them itself."""

from collections.abc import Iterator
from contextlib import contextmanager

from torch import nn


@contextmanager
def frozen(critic: nn.Module) -> Iterator[None]:
    """Inside, what is scored learns, and the critic does not.

    >>> import torch
    >>> critic = nn.Linear(1, 1)
    >>> with frozen(critic):
    ...     score = critic(torch.ones(1, 1, requires_grad=True))
    >>> score.backward()
    >>> critic.weight.grad, critic.weight.requires_grad
    (None, True)
    """
    learned = [p for p in critic.parameters() if p.requires_grad]
    for p in learned:
        p.requires_grad_(False)
    try:
        yield
    finally:
        for p in learned:
            p.requires_grad_(True)
