r"""Several processes, one training: each works on its share of a step, then gradients are averaged.

    torchrun --nproc-per-node 8 -m dancediff.cli train CONFIG
    accelerate launch --multi_gpu --num_processes 8 -m dancediff.cli train CONFIG

A step consists of ``accumulate`` times as many batches as there are processes, numbered through.
Process r takes the r-th, the (r + size)-th and so on, so that size processes give the gradient that
one process gives with size times the accumulation.
"""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass

import torch
from torch import Tensor, nn


@dataclass(frozen=True)
class World:
    """Which process this is, of how many, and where it computes.

    >>> list(World(rank=1, size=2).share(accumulate=2, step=10))
    [41, 43]
    """

    rank: int = 0
    size: int = 1
    device: str = "cpu"

    @property
    def first(self) -> bool:
        """Is this the process that writes files and shows progress?"""
        return self.rank == 0

    def share(self, step: int, accumulate: int) -> range:
        """The numbers of this process's batches in a step."""
        batches = accumulate * self.size
        return range(step * batches + self.rank, (step + 1) * batches, self.size)

    def average(self, tensors: list[Tensor]) -> None:
        """Replace each tensor by its mean over all processes, in one message."""
        if self.size == 1 or not tensors:
            return
        together = torch.cat([tensor.detach().flatten().float() for tensor in tensors])
        torch.distributed.all_reduce(together)
        together /= self.size
        parts = together.split([tensor.numel() for tensor in tensors])
        for tensor, part in zip(tensors, parts, strict=True):
            tensor.detach().copy_(part.view_as(tensor))

    def average_gradients(self, model: nn.Module) -> None:
        """Make all processes take the same step.

        A weight that this process did not use, but another may have, counts as zero.
        """
        if self.size > 1:
            weights = [p for p in model.parameters() if p.requires_grad]
            for p in weights:
                p.grad = torch.zeros_like(p) if p.grad is None else p.grad
            self.average([p.grad for p in weights if p.grad is not None])

    def any(self, flag: bool) -> bool:
        """Is it so in any process?"""
        if self.size == 1:
            return flag
        mean = torch.tensor([float(flag)], device=self.device)
        self.average([mean])
        return mean.item() > 0

    def wait(self) -> None:
        """Go on when all processes are here."""
        if self.size > 1:
            torch.distributed.barrier()


def number_in_process(number: int) -> int:
    """How many batches this process had before batch ``number``, see `World.share`.

    Of two processes one has the even numbers, the other the odd ones.

    >>> number_in_process(7)
    7
    """
    several = torch.distributed.is_available() and torch.distributed.is_initialized()
    return number // (torch.distributed.get_world_size() if several else 1)


@contextlib.contextmanager
def join_world(device: str = "cpu") -> Iterator[World]:
    """The processes that torchrun or accelerate started, else this one alone.

    With ``device="cuda"`` each process takes a GPU of its own.

    Raises: ValueError when the launcher's variables make no sense.
    """
    try:
        rank, size, local = (
            int(os.environ.get(name, default))
            for name, default in (("RANK", "0"), ("WORLD_SIZE", "1"), ("LOCAL_RANK", "0"))
        )
    except ValueError as err:
        raise ValueError(f"RANK, WORLD_SIZE and LOCAL_RANK must be whole numbers: {err}") from err
    if not 0 <= rank < size:
        raise ValueError(f"RANK={rank} must lie in 0 ... WORLD_SIZE - 1 = {size - 1}")
    if device == "cuda":
        device = f"cuda:{local}"
    if size == 1:
        yield World(device=device)
        return
    backend = "nccl" if device.startswith("cuda") else "gloo"
    if backend == "nccl":
        torch.cuda.set_device(device)
    torch.distributed.init_process_group(backend)
    try:
        yield World(rank, size, device)
    finally:
        torch.distributed.destroy_process_group()
