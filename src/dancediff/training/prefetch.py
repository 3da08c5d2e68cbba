r"""Batches that other processes cut while the network learns.

Read first: `dancediff.data.windows` · `dancediff.training.trainer`.

A GPU does a step in the time in which one core cuts the windows of one batch. The batch of a number
is the same wherever it is made, so any number of processes may make them.
"""

from collections.abc import Iterator

from torch.utils.data import DataLoader, Dataset

AHEAD = 4  # batches that each process makes in advance
LAST = 2**62  # no training counts so far


class Prefetched:
    """``data.batch(number)`` of numbers in a row, made by ``workers`` processes.

    A number out of the row costs a new start of them. ``pin``: in memory that a GPU reads directly.

    >>> class Numbers:
    ...     def batch(self, number):
    ...         return number
    >>> data = Prefetched(Numbers(), workers=0)
    >>> [data.batch(k) for k in (7, 8, 3)]
    [7, 8, 3]
    """

    def __init__(self, data, workers: int, pin: bool = False):
        self.data, self.workers, self.pin = data, workers, pin
        self._next, self._batches = -1, iter(())

    def batch(self, number: int):
        """The batch of a number."""
        if number != self._next:
            self._batches = self._from(number)
        self._next = number + 1
        return next(self._batches)

    def _from(self, number: int) -> Iterator:
        loader = DataLoader(
            _Numbered(self.data),
            batch_size=None,
            sampler=range(number, LAST),
            collate_fn=_unchanged,
            num_workers=self.workers,
            prefetch_factor=AHEAD if self.workers else None,
            pin_memory=self.pin,
        )
        return iter(loader)


class _Numbered(Dataset):
    """Batches by their number, as a `DataLoader` asks for them."""

    def __init__(self, data):
        self.data = data

    def __getitem__(self, number: int):
        return self.data.batch(number)


def _unchanged(batch):
    return batch
