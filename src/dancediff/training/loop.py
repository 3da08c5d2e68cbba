r"""One training loop for every denoiser.

Read first: notebook 05.

A step: take a batch, add noise of a random strength t, let the model guess the clean motion, and
correct it. The randomness of a batch follows from (seed, its number) alone, so a run that was
stopped goes on exactly where it was, bit by bit; only with ``max_minutes`` the clock has a say.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_0, x_t   clean and noisy motion, normalised      (b, n, f, d)
    t          diffusion step of each group            (b,)
    keep       music is heard (False: dropped)         (b,)
"""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import Tensor, nn
from tqdm.auto import tqdm

from dancediff.atomic import sweep
from dancediff.extensions.preconditioning import Preconditioning
from dancediff.papers.tcdiffpp.fusion_projection import FusionProjection
from dancediff.papers.tcdiffpp.losses import LossWeights, tcdiffpp_losses
from dancediff.training.adan import Adan
from dancediff.training.checkpoint import load_checkpoint, save_checkpoint
from dancediff.training.distributed import World
from dancediff.training.ema import EMA
from dancediff.training.loss_log import LossLog
from dancediff.training.muon import MuonAdamW
from dancediff.training.noise import noised, settled, to_network

OPTIMIZERS = ("adamw", "muon", "adan")


@dataclass(frozen=True)
class TrainConfig:
    """What a run needs besides the model and the data."""

    steps: int = 10_000
    optimizer: str = "adamw"  # or "muon", or "adan", the released code's; see `make_optimizer`
    lr: float = 1e-3
    fusion_lr: float = 0.2  # share of lr that the Fusion Projection gets; see `make_optimizer`
    warmup: int = 300  # steps until the full learning rate
    decay: float = 0.3  # last share of the run over which the learning rate falls to zero
    weight_decay: float = 0.01
    clip: float = 1.0  # longest gradient
    ema: float = 0.999
    precision: str = "fp32"  # or "bf16"
    accumulate: int = 1  # batches a step and process, whose gradients are averaged
    seed: int = 0
    save_every: int = 500  # steps
    preview_every: int = 0  # steps; 0: never
    level_power: float = 0.0  # see `level_weights`; 0: all levels count the same
    max_minutes: float | None = None  # end in this time, learning rate and all; see `schedule_step`
    weights: LossWeights = field(default_factory=LossWeights)

    @classmethod
    def paper(cls, **changes) -> "TrainConfig":
        """TCDiff++ section 5.1: Adam (no weight decay) at 5e-5; the rest as in its code.

        >>> TrainConfig.paper(steps=100).lr
        5e-05
        """
        paper = {"lr": 5e-5, "fusion_lr": 1.0, "weight_decay": 0.0, "ema": 0.9999}
        return cls(**paper | changes)

    def __post_init__(self):
        """Catch what would otherwise be noticed after an hour, or never."""
        if self.optimizer not in OPTIMIZERS:
            raise ValueError(
                f"optimizer={self.optimizer!r} is not one of {', '.join(map(repr, OPTIMIZERS))}"
            )
        if self.precision not in ("fp32", "bf16"):
            raise ValueError(f"precision={self.precision!r} is not one of 'fp32', 'bf16'")
        if not 0 <= self.decay <= 1:
            raise ValueError(f"decay={self.decay} is a share of the run; choose 0 to 1")
        if not 0 <= self.ema < 1:
            raise ValueError(f"ema={self.ema} never moves or overshoots; choose 0 to below 1")
        if not 0 <= self.level_power <= 1:
            raise ValueError(f"level_power={self.level_power} must be 0 (off) to 1")
        for name in ("steps", "lr", "fusion_lr", "clip", "save_every", "accumulate"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}={getattr(self, name)} must be above 0")
        if self.max_minutes is not None and not self.max_minutes > 0:
            raise ValueError(f"max_minutes={self.max_minutes} must be above 0, or left out")


def learning_rate(step: int, config: TrainConfig) -> float:
    """Rise, stay, fall: the long flat part lets a run be prolonged from any checkpoint.

    >>> config = TrainConfig(steps=100, lr=1.0, warmup=10, decay=0.5)
    >>> [round(learning_rate(k, config), 2) for k in (0, 9, 49, 75, 99)]
    [0.1, 1.0, 1.0, 0.5, 0.02]
    """
    rise = (step + 1) / config.warmup if config.warmup else 1.0
    fall = (config.steps - step) / max(config.decay * config.steps, 1)
    return config.lr * max(0.0, min(1.0, rise, fall))


def level_weights(error: Tensor, power: float) -> Tensor:
    r"""How much a noise level counts in the losses: the less is missed there, the more.

    $$w_t = \Big(\frac{\mathbb E_s\, e_s}{e_t}\Big)^p$$

    e is the mean square error of the linear guess. Where nearly everything is noise it is a hundred
    times larger than where nearly nothing is. Counted the same (p = 0), as in the papers, the last
    steps, which decide whether a dance trembles, are hardly trained; with p = 1 they take the
    network from those that decide when to step.

    Source: EDM section 5 (there $1 / c_\text{out}^2$, which is p = 1).

    Shapes: error (T,) -> (T,).

    >>> level_weights(torch.tensor([0.25, 4.0, 1.0, 10.75]), power=0.5)
    tensor([4.0000, 1.0000, 2.0000, 0.6100])
    """
    return (error.mean() / error) ** power


def schedule_step(step: int, seconds: float, config: TrainConfig) -> int:
    """How far the schedule is: the step, or where the clock says it should be, if that is later.

    Without ``max_minutes`` it is the step. With it a run of unknown speed still ends with a small
    learning rate, in time; the price is that it cannot be repeated bit by bit.

    >>> config = TrainConfig(steps=100, max_minutes=10)
    >>> schedule_step(5, 0.0, config), schedule_step(5, 300.0, config)
    (5, 50)
    """
    if config.max_minutes is None:
        return step
    return max(step, int(config.steps * seconds / (60 * config.max_minutes)))


def train(
    model: nn.Module,
    data,
    config: TrainConfig,
    out,
    *,
    resume: bool = False,
    compile_model: bool = False,
    world: World | None = None,
    preview: Callable | None = None,
    losses: Callable | None = None,
    extra: Callable[[], dict[str, Tensor]] | None = None,
):
    """Train ``model`` in place on ``data.batch(number)``; returns the averaged model.

    Writes ``out/checkpoint.safetensors`` and ``out/losses.csv``, and ``out/tensorboard`` where
    TensorBoard is installed. With ``resume`` it goes on from the checkpoint there, if there is one.
    The model may be on any device; batches follow it. ``world``: the processes that share the work;
    the first of them writes. ``preview(averaged model, step)`` is called every
    ``config.preview_every`` steps. ``losses``: what to do with a batch instead of `losses_of`;
    ``extra()``: what it must remember, kept in the checkpoint.

    Raises: RuntimeError naming the step when the gradient is not finite; the weights are then
    those before that step. ValueError for ``max_minutes`` with several processes.
    """
    out, world = Path(out), world or World()
    if config.max_minutes is not None and world.size > 1:
        raise ValueError(
            f"max_minutes={config.max_minutes:g} is for one process: each of {world.size} has its "
            "own clock, and one would wait for the others; leave it out, stop and use resume"
        )
    _make_folder(out, world)
    checkpoint = out / "checkpoint.safetensors"
    optimizer = make_optimizer(model, config)
    ema = EMA(model, config.ema)
    first = 0
    if resume and checkpoint.exists():
        first = load_checkpoint(checkpoint, model=model, ema=ema, optimizer=optimizer)
    levels = None
    if config.level_power:
        known = next((p for p in model.modules() if isinstance(p, Preconditioning)), None)
        if known is None:
            raise ValueError(
                f"level_power={config.level_power} needs a model with precondition=True; use 0"
            )
        levels = level_weights(known.error(model.abar.float()), config.level_power)
    forward = torch.compile(model) if compile_model else model
    model.train()
    settings = {"train": asdict(config), "model": asdict(model.config)}

    def save(step: int) -> None:
        if not world.first:
            return
        log.flush()  # first, so that the log never lacks a step which the checkpoint has
        save_checkpoint(
            checkpoint,
            model=model,
            ema=ema,
            optimizer=optimizer,
            step=step,
            config=settings,
            extra=None if extra is None else extra(),
        )

    with (
        LossLog(out / "losses.csv" if world.first else None, first) as log,
        _steps(first, config, world) as bar,
    ):
        step = saved = first
        for step in bar:
            at = schedule_step(step, log.seconds, config)
            if at >= config.steps:
                break  # time is up
            lr = learning_rate(at, config)
            options = {"lr": lr, "world": world, "levels": levels, "losses": losses}
            row = train_step(forward, model, optimizer, data, step, config, **options)
            ema.update(model)
            log.write(step, row)
            if step % 20 == 0:
                bar.set_postfix({"loss": f"{row['total']:.4f}"})
            if (step + 1) % config.save_every == 0 or step + 1 == config.steps:
                save(saved := step + 1)
            if preview and config.preview_every and (step + 1) % config.preview_every == 0:
                if world.first:
                    preview(ema.model, step + 1)
                world.wait()
        else:
            step = config.steps
        if step > saved:
            save(step)
    world.wait()
    return ema.model


def _make_folder(out: Path, world: World) -> None:
    out.mkdir(parents=True, exist_ok=True)
    if world.first:
        sweep(out)


def _steps(first: int, config: TrainConfig, world: World) -> tqdm:
    """The numbers of the steps that are left, with a bar; closed before an error is told."""
    left = range(first, config.steps)
    options = {"initial": first, "total": config.steps, "disable": not world.first}
    return tqdm(left, desc="training", **options)


def make_optimizer(model: nn.Module, config: TrainConfig) -> torch.optim.Optimizer:
    """AdamW in one fused pass over all weights, `MuonAdamW` or `Adan`.

    The Fusion Projection has its own lr, and Adam with Muon, too.

    Adam moves every weight by about lr, so what a unit adds up moves with the number of its inputs,
    and most where they are all positive. The Fusion Projection has two layers of ReLU over 512
    inputs and more: with the full lr its units fell silent within some thousand steps, for good.

    Differs: TCDiff++ writes Adam at 5e-5, its released code runs Adan at 4e-4; a small model that
    must be done in an hour wants a larger step, warm-up and clipping.
    """
    fusions = (part for part in model.modules() if isinstance(part, FusionProjection))
    slow = [weight for fusion in fusions for weight in fusion.parameters()]
    chosen = {id(weight) for weight in slow}
    rest = [weight for weight in model.parameters() if id(weight) not in chosen]
    groups = [{"params": rest, "share": 1.0}]
    groups += [{"params": slow, "share": config.fusion_lr}] if slow else []
    if config.optimizer == "muon":
        return MuonAdamW(groups, lr=config.lr, weight_decay=config.weight_decay)
    if config.optimizer == "adan":
        return Adan(groups, lr=config.lr, weight_decay=config.weight_decay)
    return torch.optim.AdamW(
        groups, lr=config.lr, betas=(0.9, 0.99), weight_decay=config.weight_decay, fused=True
    )


def train_step(
    forward,
    model,
    optimizer,
    data,
    step: int,
    config: TrainConfig,
    *,
    lr: float | None = None,
    world: World | None = None,
    levels: Tensor | None = None,
    losses: Callable | None = None,
) -> dict[str, float]:
    """One update of the weights from all batches of a step; returns the named losses' means."""
    world = world or World()
    optimizer.zero_grad(set_to_none=True)
    total: dict = {}
    for number in world.share(step, config.accumulate):
        batch = data.batch(number)
        terms = (losses or losses_of)(forward, model, batch, number, config, levels)
        (terms["total"] / config.accumulate).backward()
        for name, value in terms.items():
            total[name] = total.get(name, 0.0) + value.detach().float() / config.accumulate
    world.average_gradients(model)
    world.average(list(total.values()))
    length = nn.utils.clip_grad_norm_(model.parameters(), config.clip)
    if not length.isfinite():
        raise RuntimeError(
            f"the gradient of step {step} is not finite (loss {total['total'].item()}): "
            "lower lr, or use precision fp32, and resume"
        )
    for group in optimizer.param_groups:
        group["lr"] = group.get("share", 1.0) * (learning_rate(step, config) if lr is None else lr)
    optimizer.step()
    return {name: value.item() for name, value in total.items()}


def losses_of(
    forward, model, batch, number: int, config: TrainConfig, levels: Tensor | None = None
) -> dict:
    """Noise a batch, guess, compare; everything random follows from the seed and its number."""
    x_0, M, S = to_network(model, batch)
    x_t, t, keep, weight, _ = noised(model, x_0, number, config, levels)
    with settled(model, number, config):
        guess, adapted = forward(x_t, t, M, S, keep=keep)
    return tcdiffpp_losses(
        guess.float(),
        adapted.float(),
        x_0,
        model.normalizer,
        weights=config.weights,
        weight=weight,
    )
