r"""One trainer for every network.

Read first: notebook 05.

A step: take a batch, add noise of a random strength t, let the model guess the clean motion, and
correct it. Randomness follows from (seed, the batch's number) alone, so a stopped run goes on bit
by bit: in one process on a CPU, in a fixed precision.
"""

import json
import math
import signal
import sys
from collections.abc import Sequence
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Generic, TypeVar, cast

from torch import Tensor, nn
from tqdm.auto import tqdm

from dancediff.atomic import sweep
from dancediff.nn.dance_network import DanceNetwork, NormalizedNetwork
from dancediff.training.boards import BOARDS, check_logs
from dancediff.training.checkpoint import NAME, Checkpointer, Signals, check_free, facts_of
from dancediff.training.config import TrainConfig
from dancediff.training.distributed import World
from dancediff.training.ema import EMA
from dancediff.training.evaluator import Evaluator, due, forget
from dancediff.training.logger import Logger
from dancediff.training.objective import BatchLosses, GroupObjective
from dancediff.training.optimizer import make_optimizer, set_learning_rate
from dancediff.training.schedule import learning_rate

Network = TypeVar("Network", bound=NormalizedNetwork)
NO_WINDOW = ("folder", "workers", "held_out")  # keys of [data] that change no window of training


class Trainer(Generic[Network]):
    """Trains ``model`` in place on ``data.batch(number)``.

    - ``out``: the folder for ``checkpoint.safetensors``, ``best.safetensors`` and ``losses.csv``;
      None writes nothing.  ``log``: what else shows the numbers, "tensorboard" or "wandb".
    - ``objective``: what is minimised; by default eq. 18 of TCDiff++.
    - ``evaluator``: validation and previews.  ``world``: the processes that share the work; the
      first of them writes.  The model may be on any device; batches follow it.
    - ``resume``: go on from the checkpoint in the folder, if there is one; ``overwrite``: replace
      it.  ``data_name`` changes with the data, so that a run that goes on with other data says so.

    Raises: ValueError when the folder holds a training and neither was said.

    >>> import torch, dancediff as dd
    >>> from dancediff.data.take import DanceTake
    >>> from dancediff.data.windows import GroupCut, WindowSampler
    >>> from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
    >>> model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32))
    >>> dance, _ = dd.choreograph([0.5, 1.0, 1.5, 2.0, 2.5], dancers=2, seed=0, seconds=3)
    >>> take = DanceTake("a duo", dance, M=torch.zeros(90, 35))
    >>> data = WindowSampler([take], GroupCut(90), dancers_per_batch=2)
    >>> trained = Trainer(model, data, TrainConfig(steps=2)).run()
    """

    label = "training"  # of the bar

    def __init__(
        self,
        model: Network,
        data,
        config: TrainConfig,
        out=None,
        *,
        objective: BatchLosses | None = None,
        evaluator: Evaluator | None = None,
        world: World | None = None,
        resume: bool = False,
        overwrite: bool = False,
        data_name: str = "",
        log: str | Sequence[str] = (),
    ):
        self.model, self.data, self.config = model, data, config
        self.world = world or World()
        self.objective: BatchLosses = objective or GroupObjective(cast(DanceNetwork, model), config)
        self.evaluator = evaluator or Evaluator(None, config)
        self.optimizer = make_optimizer(model, config)
        self.ema = EMA(model, config.ema)
        self.first, self.out = 0, None if out is None else Path(out)
        self.log = check_logs(log)
        if self.out is None:
            self.checkpointer = None
            return
        check_free(self.out, resume, overwrite)
        self.out.mkdir(parents=True, exist_ok=True)
        if self.world.first:
            sweep(self.out)
        facts = facts_of(model, config, data_name)
        path = self.out / NAME
        self.checkpointer = Checkpointer(path, model, self.ema, self.optimizer, facts)
        if resume and path.exists():
            self.first = self.checkpointer.load()
            self.evaluator.go_on(self.out, self.first)
        elif self.world.first:
            forget(self.out)

    def run(self) -> Network:
        """All steps that are left; returns the averaged model.

        Raises: RuntimeError naming the step when the gradient is not finite; the weights are then
        those before that step. SystemExit after SIGTERM, when the checkpoint is written.
        """
        self.model.train()
        with self._logger() as logger, Signals() as signals, self._steps() as steps:
            for step in steps:
                row = self.step(step) | self._validate(step + 1)
                logger.write(step, row)
                steps.set_postfix({"loss": f"{row['total']:.4f}"}, refresh=False)
                enough = self._is_enough(step + 1)
                signals.save = signals.save or enough
                self._save(step + 1, logger, signals)
                self._preview(step + 1, logger)
                if enough:
                    break
        self.world.wait()
        return self.ema.model

    def step(self, step: int) -> dict[str, float]:
        """One update of all weights; returns the losses, the learning rate and the gradient's norm.

        All batches of the step count alike.
        """
        config = self.config
        total: dict[str, Tensor] = {}
        self.optimizer.zero_grad(set_to_none=True)
        for number in self.world.share(step, config.accumulate):
            terms = self.objective.losses(self.model, self.data.batch(number), number)
            (terms["total"] / config.accumulate).backward()
            for name, value in terms.items():
                share = value.detach().float() / config.accumulate
                total[name] = total[name] + share if name in total else share
        self.world.average_gradients(self.model)
        self.world.average(list(total.values()))
        norm = nn.utils.clip_grad_norm_(self.model.parameters(), config.clip or math.inf)
        if not norm.isfinite():
            raise RuntimeError(
                f"the gradient of step {step} is not finite (loss {total['total'].item()}): "
                "lower lr, or use precision fp32, and resume"
            )
        lr = learning_rate(step, config)
        set_learning_rate(self.optimizer, lr)
        self.optimizer.step()
        self.ema.update(self.model)
        losses = {name: value.item() for name, value in total.items()}
        return losses | {"lr": lr, "gradient": norm.item()}

    @cached_property
    def left(self) -> range:
        """The numbers of the steps that are left; none where all are done, or no more help."""
        return range(self.first, self.first if self._is_enough(self.first) else self.config.steps)

    def is_due(self, step: int) -> bool:
        """Is it time for a checkpoint after ``step`` steps?"""
        return step % self.config.save_every == 0 or step == self.config.steps

    def _logger(self) -> Logger:
        if self.out is None or self.checkpointer is None or not self.world.first:
            return Logger(None)
        facts = self.checkpointer.facts
        boards = [BOARDS[name](self.out, self.first, facts) for name in self.log]
        return Logger(self.out / "losses.csv", self.first, boards)

    def _steps(self) -> tqdm:
        """The numbers of the steps that are left, with a bar; closed before an error is shown."""
        left = self.left  # first: what the bar counts to may follow from it
        options = {"initial": self.first, "total": self._total(), "mininterval": 0.5}
        return tqdm(left, desc=self.label, disable=not self.world.first, **options)

    def _total(self) -> float:
        """How many steps the bar counts to; infinitely many where that is not known yet."""
        return self.config.steps

    def _is_enough(self, step: int) -> bool:
        """Has training brought nothing for so long that it ends after ``step`` steps?"""
        config, best = self.config, self.evaluator.best_step
        if config.patience == 0:
            return False
        enough = self.world.any(self.world.first and self.evaluator.is_enough(step))
        if enough and self.world.first:
            text = f"training ends after {step} of {config.steps} steps: none of the last "
            text += f"{config.patience} evaluations was better than that after {best} steps"
            tqdm.write(text, file=sys.stderr)
        return enough

    def _validate(self, step: int) -> dict[str, float | None]:
        """The validation loss after ``step`` steps, None when it is not its turn."""
        if not self.evaluator.evaluates:
            return {}
        if not due(step, self.config.evaluate_every):
            return {"validation": None}
        loss = None
        if self.world.first:
            loss = self.evaluator.validation_loss(self.ema.model, self.objective)
            self.evaluator.keep_best(self.ema.model, loss, step, self.out)
        self.world.wait()
        return {"validation": loss}

    def _save(self, step: int, logger: Logger, signals: Signals) -> None:
        """Write a checkpoint when it is time or somebody asks for one, and stop if asked to."""
        stop, asked = self.world.any(signals.stop), self.world.any(signals.save)
        if self.checkpointer is not None and self.world.first and (self.is_due(step) or asked):
            logger.flush()  # first, so that the log never lacks a step which the checkpoint has
            self.checkpointer.save(step, self.objective.state())
        signals.save = False
        if stop:
            raise SystemExit(128 + signal.SIGTERM)

    def _preview(self, step: int, logger: Logger) -> None:
        if self.evaluator.preview and due(step, self.config.preview_every):
            if self.world.first:
                self.evaluator.preview(self.ema.model, step)
            self.world.wait()
        if self.evaluator.metrics and due(step, self.config.metrics_every):
            if self.world.first:
                model = cast(DanceNetwork, self.ema.model)
                scores = self.evaluator.metrics.row(model, self.objective, step)
                logger.show(step - 1, "metrics", scores)
            self.world.wait()


def name_of(takes: Sequence, corpus: dict) -> str:
    """A short name for what is learned from: takes, some frames of each, how windows are drawn.

    >>> name_of([], {}) == name_of([], {"workers": 8}), name_of([], {}) == name_of([], {"real": 1})
    (True, False)
    """
    drawn = {key: value for key, value in corpus.items() if key not in NO_WINDOW}
    facts = [[take.name, *take.x.shape, _glance(take.x)] for take in takes], drawn
    return sha256(json.dumps(facts, sort_keys=True).encode()).hexdigest()[:12]


def _glance(x: Tensor) -> str:
    """A hash of eight frames or so (n, f, d): to read all of a large data set takes minutes."""
    frames = x[:, :: max(1, x.shape[1] // 8)].contiguous().float()
    return sha256(frames.numpy().tobytes()).hexdigest()[:8]
