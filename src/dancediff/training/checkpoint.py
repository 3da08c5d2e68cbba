"""Checkpoints: everything needed to go on, in one safetensors file that is whole or absent."""

import json
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import nn

from dancediff.atomic import save_tensors
from dancediff.training.ema import EMA


def save_checkpoint(
    path,
    *,
    model: nn.Module,
    ema: EMA,
    optimizer,
    step: int,
    config: dict,
    extra: dict[str, torch.Tensor] | None = None,
):
    """Write weights, averaged weights and optimiser moments; ``extra``: see `load_extra`.

    The old file stays until the new one is whole. No random state is kept: a step's randomness
    follows from its number.
    """
    path = Path(path)
    tensors = {f"model.{k}": v for k, v in model.state_dict().items()}
    tensors |= {f"ema.{k}": v for k, v in ema.model.state_dict().items()}
    for i, state in optimizer.state_dict()["state"].items():
        tensors |= {f"optimizer.{i}.{k}": torch.as_tensor(v) for k, v in state.items()}
    tensors |= {f"extra.{k}": v for k, v in (extra or {}).items()}
    facts = {"step": step, "ema_updates": ema.updates, "config": config}
    meta = {"facts": json.dumps(facts)}  # one entry: safetensors writes several in any order
    save_tensors({k: v.detach().contiguous().clone() for k, v in tensors.items()}, path, meta)


def load_checkpoint(path, *, model: nn.Module, ema: EMA, optimizer) -> int:
    """Put a checkpoint back where it came from; returns the step it was written after.

    Raises: ValueError naming the file when it is no checkpoint of this model.
    """
    try:
        with safe_open(path, "pt") as file:
            facts = json.loads(file.metadata()["facts"])
            tensors = {k: file.get_tensor(k) for k in file.keys()}
        model.load_state_dict(_part(tensors, "model."))
        ema.model.load_state_dict(_part(tensors, "ema."))
        state: dict = {}
        for name, value in _part(tensors, "optimizer.").items():
            i, key = name.split(".", 1)
            state.setdefault(int(i), {})[key] = value
        groups = optimizer.state_dict()["param_groups"]
        optimizer.load_state_dict({"state": state, "param_groups": groups})
        ema.updates = int(facts["ema_updates"])
        return int(facts["step"])
    except (SafetensorError, RuntimeError, KeyError, ValueError, TypeError) as err:
        raise ValueError(f"{path} is no checkpoint of this model: {err}") from err


def load_extra(path) -> dict[str, torch.Tensor]:
    """What else was written into a checkpoint, so that both are of the same step.

    Raises: ValueError naming the file when it is no checkpoint.
    """
    try:
        with safe_open(path, "pt") as file:
            names = [name for name in file.keys() if name.startswith("extra.")]
            return _part({name: file.get_tensor(name) for name in names}, "extra.")
    except (SafetensorError, OSError) as err:
        raise ValueError(f"{path} is no checkpoint: {err}") from err


def load_average(path, model: nn.Module) -> nn.Module:
    """Put a checkpoint's averaged weights into a model; returns it.

    Raises: ValueError naming the file when it is no checkpoint of this model.
    """
    try:
        with safe_open(path, "pt") as file:
            tensors = {k: file.get_tensor(k) for k in file.keys() if k.startswith("ema.")}
        model.load_state_dict(_part(tensors, "ema."))
    except (SafetensorError, OSError, RuntimeError) as err:
        raise ValueError(f"{path} is no checkpoint of this model: {err}") from err
    return model


def _part(tensors: dict, prefix: str) -> dict:
    return {k.removeprefix(prefix): v for k, v in tensors.items() if k.startswith(prefix)}
