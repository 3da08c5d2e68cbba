r"""Training on a GPU in CUDA graphs: the same steps, started with one call instead of thousands.

Read first: `dancediff.training.trainer` · `dancediff.training.prefetch`.

A step of these small networks consists of some eight thousand kernels of a few microseconds each;
to start them one by one takes longer than to run them. A CUDA graph records them once, for each
shape of batch, and starts all of them together. What is recorded: the network, the losses, their
gradient and the optimiser. What is random is drawn before, as on a CPU.

Symbols
    theta   all weights before a step
    s       learning rate of the step, as a share of the highest
"""

import math
import os
from dataclasses import dataclass
from typing import cast

import torch
from torch import Tensor, nn

from dancediff.nn.dance_network import NormalizedNetwork
from dancediff.training.checkpoint import Signals
from dancediff.training.config import TrainConfig
from dancediff.training.distributed import World
from dancediff.training.logger import Logger
from dancediff.training.objective import BatchLosses, Drawn, Objective
from dancediff.training.optimizer import set_learning_rate
from dancediff.training.prefetch import Prefetched
from dancediff.training.schedule import learning_rate
from dancediff.training.trainer import Trainer

WORKERS = 8  # processes that cut windows
RECORDABLE = ("adam", "adamw", "muon")
EAGER = 2  # batches of a shape before it is recorded: caches fill, libraries choose their kernels


@dataclass
class Recorded:
    """A graph, the tensors it reads and those it writes."""

    graph: "torch.cuda.CUDAGraph"
    inputs: list[Tensor]
    names: list[str]
    losses: Tensor  # of the names, and last the gradient's norm


class Late:
    """Numbers on their way from the GPU.

    >>> Late(torch.tensor([1.0, 2.0])).read()
    [1.0, 2.0]
    """

    def __init__(self, numbers: Tensor):
        on_gpu = numbers.is_cuda
        self.numbers = torch.empty(numbers.shape, pin_memory=on_gpu)
        self.numbers.copy_(numbers, non_blocking=True)
        self.arrived = torch.cuda.Event() if on_gpu else None
        if self.arrived is not None:
            self.arrived.record()

    def read(self) -> list[float]:
        """Wait until they are there."""
        if self.arrived is not None:
            self.arrived.synchronize()
        return self.numbers.tolist()


class GraphTrainer(Trainer[NormalizedNetwork]):
    r"""`Trainer` for one GPU.

    A recorded optimiser cannot take another learning rate, so it takes the highest, and the weights
    then go back by the share that was too much:

    $$\theta \leftarrow \theta + s\,(\theta' - \theta)$$

    AdamW and Muon move weights in proportion to the learning rate, weight decay included, so this
    is the step that they would have taken (a test holds that).

    Losses are read a step late, so that the GPU need not wait: the row of step k in losses.csv is
    that of step k - 1. Dropout draws from the GPU's own generator.

    Raises: ValueError for what `fits_graphs` refuses.
    """

    def __init__(self, model: NormalizedNetwork, data, config: TrainConfig, out=None, **options):
        pin = model.normalizer.low.is_cuda
        data = Prefetched(data, min(WORKERS, os.cpu_count() or 1), pin)
        super().__init__(model, data, config, out, **options)
        if not fits_graphs(self.objective, config, self.world):
            raise ValueError(
                f"CUDA graphs are for one process (here {self.world.size}), accumulate=1 (here "
                f"{config.accumulate}), networks and losses of dancediff that draw nothing, and "
                f"{', '.join(RECORDABLE)} (here {config.optimizer}); use Trainer"
            )
        for group in self.optimizer.param_groups:
            group["capturable"] = True
        self.weights: list[Tensor] = [p for p in model.parameters() if p.requires_grad]
        self.before = [p.detach().clone() for p in self.weights]
        self.seen: dict[tuple, int] = {}
        self.recorded: dict[tuple, Recorded] = {}
        self.late: Late | None = None
        self.stream: torch.cuda.Stream | None = None

    def step(self, step: int) -> dict[str, float]:
        """One update of all weights; returns the losses and the norm of the step before."""
        drawn = cast(Objective, self.objective).drawn(self.model, self.data.batch(step), step)
        inputs = drawn.tensors()
        shape = tuple(tuple(x.shape) for x in inputs)
        self.seen[shape] = self.seen.get(shape, 0) + 1
        lr = learning_rate(step, self.config)
        if self.seen[shape] <= EAGER:
            names, losses = self._update(drawn, lr)
        else:
            if shape not in self.recorded:
                self.recorded[shape] = self._record(drawn)
            recorded = self.recorded[shape]
            with torch.no_grad():
                torch._foreach_copy_(recorded.inputs, inputs)
                torch._foreach_copy_(self.before, self.weights)
                recorded.graph.replay()
                go_back(self.before, self.weights, lr / self.config.lr)
            names, losses = recorded.names, recorded.losses
        self.ema.update(self.model)
        return self._row(names, losses, step) | {"lr": lr}

    def _update(self, drawn: Drawn, lr: float) -> tuple[list[str], Tensor]:
        """Losses, gradient and step: what is recorded."""
        self.optimizer.zero_grad(set_to_none=True)
        terms = cast(Objective, self.objective).compared(self.model, drawn)
        terms["total"].backward()
        norm = nn.utils.clip_grad_norm_(self.weights, self.config.clip or math.inf)
        set_learning_rate(self.optimizer, lr)
        self.optimizer.step()
        return list(terms), torch.stack([*(x.detach().float() for x in terms.values()), norm])

    def _record(self, drawn: Drawn) -> Recorded:
        """A graph of the step, with inputs of its own."""
        fixed, graph = drawn.clone(), torch.cuda.CUDAGraph()
        # Matrix products keep scratch memory for each stream: in one stream for all trainings of
        # a process, two graphs that run at the same time would write into the same memory.
        if self.stream is None:
            self.stream = torch.cuda.Stream()
        torch.cuda.synchronize()
        # meanwhile a thread pins the memory of batches, which must not spoil the recording
        with torch.cuda.graph(graph, stream=self.stream, capture_error_mode="thread_local"):
            names, losses = self._update(fixed, self.config.lr)
        return Recorded(graph, fixed.tensors(), names, losses)

    def _row(self, names: list[str], losses: Tensor, step: int) -> dict[str, float]:
        """The numbers of the step before; at the first step those of the first."""
        now = Late(losses)
        known, self.late = (now if self.late is None else self.late), now
        *values, norm = known.read()
        _check_finite(norm, max(0, step - 1))
        return dict(zip(names, values, strict=True)) | {"gradient": norm}

    def _save(self, step: int, logger: Logger, signals: Signals) -> None:
        """As `Trainer`, but not before the last step is known to be sound."""
        due = self.is_due(step)
        if self.late is not None and (due or signals.save or signals.stop):
            _check_finite(self.late.read()[-1], step - 1)
        super()._save(step, logger, signals)


def _check_finite(norm: float, step: int) -> None:
    if not math.isfinite(norm):
        raise RuntimeError(
            f"the gradient of step {step} is not finite: lower lr, or use precision fp32, and "
            "resume"
        )


def fits_graphs(objective: BatchLosses, config: TrainConfig, world: World | None) -> bool:
    """Is this a training whose steps may be recorded?

    Not with code of the user's own, which may ask a tensor for its number, and not with Adan, which
    counts its steps on the CPU.
    """
    alone = world is None or world.size == 1
    draws_first = isinstance(objective, Objective) and objective.draws_first
    ours = objective.model.__module__.startswith("dancediff.")
    ours = ours and config.extensions.own_loss is None
    known = config.optimizer in RECORDABLE
    return alone and config.accumulate == 1 and draws_first and ours and known


def trainer_for(objective: BatchLosses, config: TrainConfig, world: World | None) -> type[Trainer]:
    """`GraphTrainer` on a GPU where it can do the training, else `Trainer`."""
    on_gpu = objective.device.type == "cuda"
    return GraphTrainer if on_gpu and fits_graphs(objective, config, world) else Trainer


def go_back(before: list[Tensor], weights: list[Tensor], share: float) -> None:
    """Take a share of the way from ``before`` to ``weights``, in place; ``before`` is used up.

    >>> before, weights = [torch.zeros(1)], [torch.ones(1)]
    >>> go_back(before, weights, 0.25)
    >>> weights
    [tensor([0.2500])]
    """
    if share == 1.0:
        return
    torch._foreach_lerp_(before, weights, share)
    torch._foreach_copy_(weights, before)
