r"""What training does to a batch before the network sees it; all of it follows from its number.

Symbols (axes: b batch · f frames · d motion features, perhaps dancers in between)
    x_0, x_t   clean and noisy motion, normalised       (b, ..., f, d)
    t          diffusion step                           (b,)
    keep       music is heard (False: dropped)          (b,)
    config     a `dancediff.training.loop.TrainConfig`: its seed and precision count here
"""

from contextlib import contextmanager

import torch
from torch import Tensor

from dancediff.diffusion.schedule import q_sample
from dancediff.tcdiffpp.context import LOUDEST, OWN, context_length


def to_network(model, batch) -> tuple[Tensor, Tensor, Tensor]:
    """Motion and music of a batch in the network's units, and its third part, on its device."""
    x, M, other = (part.to(model.abar.device) for part in batch)
    return model.normalizer.normalize(x), model.music_normalizer.normalize(M), other


def noised(
    model, x_0: Tensor, number: int, config, levels: Tensor | None = None
) -> tuple[Tensor, Tensor, Tensor, Tensor | None, torch.Generator]:
    """A batch with noise, its steps, which rows hear the music, their weights, and more chance.

    With ``levels`` (T,), see `dancediff.training.loop.level_weights`, a step is drawn in proportion
    to the root of its weight and counts for the rest of it: the same losses in the mean, but fewer
    rows that hardly count. Without them there are no weights (None).
    """
    device, b = x_0.device, len(x_0)
    g = torch.Generator().manual_seed(_seed(number, config))  # CPU: the same on every device
    if levels is None:
        t, weight = torch.randint(model.config.num_steps, (b,), generator=g).to(device), None
    else:
        odds = levels.sqrt().cpu()
        t = torch.multinomial(odds, b, replacement=True, generator=g).to(device)
        weight = levels[t] / odds.to(device)[t] * odds.mean()
    eps = torch.randn(x_0.shape, generator=g).to(device)
    keep = (torch.rand(b, generator=g) >= model.config.cond_drop).to(device)
    return q_sample(x_0, t, model.abar, eps).to(x_0.dtype), t, keep, weight, g


@torch.no_grad()
def with_context(
    forward, model, x_0: Tensor, x_t: Tensor, t: Tensor, M: Tensor, S: Tensor, g: torch.Generator
) -> tuple[Tensor, Tensor | None]:
    """Make the first frames of a batch known, as long sampling does: x_t with them, and they.

    Half of the time they are the network's own guess from noise, so that it learns to dance on
    from frames that are not quite right; then x_t has the noise it had, but over that guess.
    """
    k = context_length(x_0.shape[2], g)
    own = float(torch.rand((), generator=g)) < OWN
    level = torch.randint(LOUDEST, (len(x_0),), generator=g).to(x_0.device)
    eps = torch.randn(x_0.shape, generator=g).to(x_0.device)
    if k == 0:
        return x_t, None
    known = x_0[:, :, :k]
    if own:
        level = level * model.config.num_steps // 1000
        guess = forward(q_sample(x_0, level, model.abar, eps).to(x_0.dtype), level, M, S)[1]
        known = guess[:, :, :k].to(x_0.dtype)
        signal = model.abar[t].sqrt().to(x_0.dtype)[:, None, None, None]
        x_t = torch.cat([x_t[:, :, :k] + signal * (known - x_0[:, :, :k]), x_t[:, :, k:]], dim=2)
    return x_t, known


@contextmanager
def settled(model, number: int, config):
    """Inside, dropout follows from the batch's number, and numbers are as short as asked for."""
    device = model.abar.device
    with torch.random.fork_rng(devices=[device] if device.type == "cuda" else []):
        torch.manual_seed(_seed(number, config))  # dropout has no generator argument
        with torch.autocast(device.type, torch.bfloat16, enabled=config.precision == "bf16"):
            yield


def _seed(number: int, config) -> int:
    return config.seed * 1_000_003 + number
