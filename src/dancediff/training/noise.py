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
