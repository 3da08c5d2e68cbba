"""The optimiser of a training."""

from typing import Any

import torch
from torch import nn

from dancediff.nn.decoder import FusionProjection
from dancediff.training.adan import Adan
from dancediff.training.config import TrainConfig
from dancediff.training.muon import MuonAdamW


def make_optimizer(model: nn.Module, config: TrainConfig) -> torch.optim.Optimizer | MuonAdamW:
    """AdamW or Adam in one fused pass over all weights, `MuonAdamW` or `Adan`.

    The Fusion Projection has its own lr, and Adam with Muon, too.

    Adam moves every weight by about lr, so what a unit adds up moves with the number of its inputs,
    and most where they are all positive. The Fusion Projection has two layers of ReLU over 512
    inputs and more: with the full lr its units fell silent within some thousand steps, for good.

    Differs: TCDiff++ writes Adam at 5e-5 (configs/tcdiffpp_paper.toml), its released code runs Adan
    at 4e-4; a small model that must be done in an hour wants a larger step, warm-up and clipping.
    """
    fusions = (part for part in model.modules() if isinstance(part, FusionProjection))
    slow = [weight for fusion in fusions for weight in fusion.parameters()]
    chosen = {id(weight) for weight in slow}
    rest = [weight for weight in model.parameters() if id(weight) not in chosen]
    groups: list[dict[str, Any]] = [{"params": rest, "share": 1.0}]
    groups += [{"params": slow, "share": config.fusion_lr}] if slow else []
    options: dict[str, Any] = {"lr": config.lr, "weight_decay": config.weight_decay}
    if config.optimizer == "muon":
        return MuonAdamW(groups, **options)
    if config.optimizer == "adan":
        return Adan(groups, **options)
    if config.optimizer == "adam":
        return torch.optim.Adam(groups, fused=True, **options)
    return torch.optim.AdamW(groups, betas=(0.9, 0.99), fused=True, **options)


def set_learning_rate(optimizer, lr: float) -> None:
    """Give each group of weights its share of lr."""
    for group in optimizer.param_groups:
        group["lr"] = group.get("share", 1.0) * lr
