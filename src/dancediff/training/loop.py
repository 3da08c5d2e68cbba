r"""One training loop for every denoiser.

Read first: notebook 05.

A step: take a batch, add noise of a random strength t, let the model guess the clean motion, and
correct it. The randomness of a step follows from (seed, step) alone, so a run that was stopped goes
on exactly where it was.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_0, x_t   clean and noisy motion, normalised      (b, n, f, d)
    t          diffusion step of each group            (b,)
    keep       music is heard (False: dropped)         (b,)
"""

import csv
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
from torch import nn
from tqdm.auto import tqdm

from dancediff.diffusion.schedule import q_sample
from dancediff.tcdiffpp.losses import LossWeights, tcdiffpp_losses
from dancediff.training.checkpoint import load_checkpoint, save_checkpoint
from dancediff.training.ema import EMA


@dataclass(frozen=True)
class TrainConfig:
    """What a run needs besides the model and the data."""

    steps: int = 10_000
    lr: float = 1e-3
    warmup: int = 300  # steps until the full learning rate
    decay: float = 0.3  # last share of the run over which the learning rate falls to zero
    weight_decay: float = 0.01
    clip: float = 1.0  # longest gradient
    ema: float = 0.999
    precision: str = "fp32"  # or "bf16"
    seed: int = 0
    save_every: int = 500  # steps
    weights: LossWeights = field(default_factory=LossWeights)


def learning_rate(step: int, config: TrainConfig) -> float:
    """Rise, stay, fall: the long flat part lets a run be prolonged from any checkpoint.

    >>> config = TrainConfig(steps=100, lr=1.0, warmup=10, decay=0.5)
    >>> [round(learning_rate(k, config), 2) for k in (0, 9, 49, 75, 99)]
    [0.1, 1.0, 1.0, 0.5, 0.02]
    """
    rise = (step + 1) / config.warmup if config.warmup else 1.0
    fall = (config.steps - step) / max(config.decay * config.steps, 1)
    return config.lr * max(0.0, min(1.0, rise, fall))


def train(model: nn.Module, data, config: TrainConfig, out, *, resume=False, compile_model=False):
    """Train ``model`` in place on ``data.batch(step)``; returns the averaged model.

    Writes ``out/checkpoint.safetensors`` and ``out/losses.csv``. With ``resume`` it goes on from
    the checkpoint there, if there is one.
    """
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    checkpoint = out / "checkpoint.safetensors"
    optimizer = torch.optim.AdamW(
        model.parameters(), lr=config.lr, betas=(0.9, 0.99),
        weight_decay=config.weight_decay, fused=True
    )
    ema = EMA(model, config.ema)
    first = 0
    if resume and checkpoint.exists():
        first = load_checkpoint(checkpoint, model=model, ema=ema, optimizer=optimizer)
    forward = torch.compile(model) if compile_model else model
    model.train()
    saved = {"train": asdict(config), "model": asdict(model.config)}
    with (out / "losses.csv").open("a" if first else "w", newline="") as file:
        log = csv.writer(file)
        started = time.monotonic()
        bar = tqdm(range(first, config.steps), initial=first, total=config.steps, desc="training")
        for step in bar:
            terms = train_step(forward, model, optimizer, data.batch(step), step, config)
            ema.update(model)
            row = {name: value.item() for name, value in terms.items()}
            if step == 0:
                log.writerow(["step", "seconds", *row])
            log.writerow([step, f"{time.monotonic() - started:.1f}", *(f"{v:.6g}" for v in row.values())])
            if step % 20 == 0:
                bar.set_postfix({"loss": f"{row['total']:.4f}"})
            if (step + 1) % config.save_every == 0 or step + 1 == config.steps:
                file.flush()
                save_checkpoint(
                    checkpoint, model=model, ema=ema, optimizer=optimizer, step=step + 1, config=saved
                )
    return ema.model


def train_step(forward, model, optimizer, batch, step: int, config: TrainConfig) -> dict:
    """Noise, guess, correct: one update of the weights; returns the named losses."""
    x_raw, M_raw, S = batch
    g = torch.Generator().manual_seed(config.seed * 1_000_003 + step)
    torch.manual_seed(config.seed * 1_000_003 + step)  # dropout has no generator argument
    b = len(x_raw)
    x_0 = model.normalizer.normalize(x_raw)
    M = model.music_normalizer.normalize(M_raw)
    t = torch.randint(model.config.num_steps, (b,), generator=g)
    x_t = q_sample(x_0, t, model.abar, torch.randn(x_0.shape, generator=g)).to(x_0.dtype)
    keep = torch.rand(b, generator=g) >= model.config.cond_drop
    with torch.autocast("cpu", torch.bfloat16, enabled=config.precision == "bf16"):
        guess, adapted = forward(x_t, t, M, S, keep=keep)
    terms = tcdiffpp_losses(
        guess.float(), adapted.float(), x_0, model.normalizer, weights=config.weights
    )
    optimizer.zero_grad(set_to_none=True)
    terms["total"].backward()
    nn.utils.clip_grad_norm_(model.parameters(), config.clip)
    for group in optimizer.param_groups:
        group["lr"] = learning_rate(step, config)
    optimizer.step()
    return terms
