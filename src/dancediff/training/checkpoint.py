"""Checkpoints: everything needed to go on, in one safetensors file that is whole or absent.

Read first: `dancediff.training.trainer`.
"""

import json
import signal
import threading
import warnings
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from torch import nn

from dancediff.atomic import save_tensors, tensor_name
from dancediff.extensions.build import extensions_of
from dancediff.extensions.genre_condition import genres_of
from dancediff.nn.dance_network import NormalizedNetwork
from dancediff.training.config import TrainConfig
from dancediff.training.ema import EMA, Network
from dancediff.training.muon import MuonAdamW

NAME = "checkpoint.safetensors"
_ERRORS = (SafetensorError, OSError, AttributeError, RuntimeError, KeyError, ValueError, TypeError)
_MAY_CHANGE = {"steps", "save_every", "patience"}
_MAY_CHANGE |= {"evaluate_every", "preview_every", "metrics_every"}
_FITTED = ("masked_music", "metre_unit")  # extensions: in scales, which only a new run fits


@dataclass
class Checkpointer:
    """Writes and reads the checkpoint of one training: weights, averages, optimiser moments.

    No random state is kept; only dropout in CUDA graphs would need it. ``facts`` describe the run,
    see `facts_of`; a run that goes on compares them with its own.
    """

    path: Path
    model: nn.Module
    ema: EMA
    optimizer: torch.optim.Optimizer | MuonAdamW
    facts: dict

    def save(self, step: int, extra: dict[str, torch.Tensor] | None = None) -> None:
        """Write what is needed to go on after ``step`` steps; the old file stays until then."""
        tensors = _named("model", self.model.state_dict())
        tensors |= _named("ema", self.ema.model.state_dict()) | _named("extra", extra or {})
        for i, state in self.optimizer.state_dict()["state"].items():
            tensors |= _named(f"optimizer.{i}", {k: torch.as_tensor(v) for k, v in state.items()})
        facts = {"step": step, "ema_updates": self.ema.updates, "config": self.facts}
        _write(self.path, tensors, facts)

    def load(self) -> int:
        """Put everything back where it came from; returns the number of steps that are done.

        Warns: of other data and of other settings than those the checkpoint was written with.
        Raises: ValueError when it is none, or one of another model, optimiser or scale.
        """
        facts = read_facts(self.path)
        self._compare(_table(facts, "config"))
        try:
            tensors = _read(self.path)
            self.model.load_state_dict(_part(tensors, "model"))
            self.ema.model.load_state_dict(_part(tensors, "ema"))
            state: dict = {}
            for name, value in _part(tensors, "optimizer").items():
                i, key = name.split(".", 1)
                state.setdefault(int(i), {})[key] = value
            groups = self.optimizer.state_dict()["param_groups"]
            self.optimizer.load_state_dict({"state": state, "param_groups": groups})
            self.ema.updates = int(facts["ema_updates"])
            return int(facts["step"])
        except _ERRORS as err:
            raise _no_checkpoint(self.path, err, " of this model") from err

    def _compare(self, old: dict) -> None:
        """Say what is other than it was."""
        was, now = _table(old, "train"), _table(self.facts, "train")
        train = _changes(was, now)
        extensions = _changes(_table(was, "extensions"), _table(now, "extensions"))
        for name, changes in (
            ("model", _changes(_table(old, "model"), _table(self.facts, "model"))),
            ("optimizer", _only(train, ("optimizer",))),
            ("scale of motion or music", _only(extensions, _FITTED)),
        ):
            if changes:
                text = f"{self.path} holds another {name} ({_said(changes)}); use its config, "
                raise ValueError(f"{text}or overwrite")
        if train:
            text = f"{self.path} was written with other settings: {_said(train)}"
            warnings.warn(text, stacklevel=4)
        if old.get("data", self.facts.get("data")) != self.facts.get("data"):
            text = f"{self.path} was written in a training on other data; it goes on with yours"
            warnings.warn(text, stacklevel=4)


def facts_of(model: NormalizedNetwork, config: TrainConfig, data: str) -> dict:
    """What a checkpoint says of its training; ``data`` changes with what is learned from."""
    names = {"extensions": extensions_of(model), "genres": genres_of(model)}
    facts = {"train": asdict(config), "model": asdict(model.config) | names, "data": data}
    return json.loads(json.dumps(facts))


def _table(facts: dict, name: str) -> dict:
    value = facts.get(name)
    return value if isinstance(value, dict) else {}


def _changes(old: dict, new: dict) -> dict[str, tuple]:
    both = [key for key in new if key in old and key not in _MAY_CHANGE]
    return {key: (old[key], new[key]) for key in both if _known(old[key], new[key]) != new[key]}


def _only(changes: dict[str, tuple], keys: Iterable[str]) -> dict[str, tuple]:
    return {key: changes[key] for key in keys if key in changes}


def _said(changes: dict[str, tuple]) -> str:
    return ", ".join(f"{key}={was}, here {now}" for key, (was, now) in changes.items())


def _known(old, new):
    """A table of before with the settings that have come since, as they are now."""
    tables = isinstance(old, dict) and isinstance(new, dict)
    return {key: old.get(key, value) for key, value in new.items()} if tables else old


def check_free(folder: Path, resume: bool | None, overwrite: bool | None) -> None:
    """Refuse to train where a checkpoint lies, unless it was said what shall become of it.

    Raises: ValueError naming the folder.
    """
    if resume and overwrite:
        raise ValueError("resume and overwrite exclude each other; choose one")
    if (folder / NAME).exists() and not resume and not overwrite:
        raise ValueError(
            f"{str(folder)!r} holds a training; go on with it (resume), replace it (overwrite) or "
            "choose another folder"
        )


class Signals:
    """Requests from outside, answered between two steps: SIGTERM to stop, SIGUSR1 to save.

    Inside the context they only set ``stop`` and ``save``.
    """

    def __init__(self):
        self.stop = self.save = False
        self._before: dict = {}

    def __enter__(self):
        if threading.current_thread() is threading.main_thread():
            for name in ("SIGTERM", "SIGUSR1"):
                if hasattr(signal, name):  # Windows has no SIGUSR1
                    number = getattr(signal, name)
                    self._before[number] = signal.signal(number, self._note)
        return self

    def __exit__(self, *_):
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _note(self, number, _frame) -> None:
        self.save = True
        self.stop = self.stop or number == signal.SIGTERM


def save_average(path, model: nn.Module, facts: dict) -> None:
    """Write averaged weights alone, for `load_average`."""
    _write(path, _named("ema", model.state_dict()), facts)


def load_average(path, model: Network) -> Network:
    """Put a checkpoint's averaged weights into a model; returns it.

    Raises: ValueError naming the file when it is no checkpoint of this model.
    """
    try:
        model.load_state_dict(_part(_read(path, "ema."), "ema"))
    except _ERRORS as err:
        raise _no_checkpoint(path, err, " of this model") from err
    return model


def load_extra(path) -> dict[str, torch.Tensor]:
    """What else was written into a checkpoint, so that both are of the same step.

    Raises: ValueError naming the file when it is no checkpoint.
    """
    try:
        return _part(_read(path, "extra."), "extra")
    except _ERRORS as err:
        raise _no_checkpoint(path, err) from err


def read_facts(path) -> dict:
    """What a checkpoint says of itself.

    Raises: ValueError naming the file when it is no checkpoint.
    """
    try:
        with safe_open(path, "pt") as file:
            return dict(json.loads(file.metadata()["facts"]))
    except _ERRORS as err:
        raise _no_checkpoint(path, err) from err


def _no_checkpoint(path, err: Exception, of: str = "") -> ValueError:
    """With the beginning of an error; PyTorch names every weight that does not fit."""
    text = " ".join(str(err).split())
    return ValueError(f"{path} is no checkpoint{of}: {text[:200]}{' ...' * (len(text) > 200)}")


def _write(path, tensors: dict, facts: dict) -> None:
    meta = {"facts": json.dumps(facts)}  # one entry: safetensors writes several in any order
    save_tensors({k: v.detach().contiguous().clone() for k, v in tensors.items()}, Path(path), meta)


def _read(path, prefix: str = "") -> dict:
    with safe_open(path, "pt") as file:
        return {tensor_name(k): file.get_tensor(k) for k in file.keys() if k.startswith(prefix)}


def _named(prefix: str, tensors: dict) -> dict:
    return {f"{prefix}.{k}": v for k, v in tensors.items()}


def _part(tensors: dict, prefix: str) -> dict:
    start = f"{prefix}."
    return {k.removeprefix(start): v for k, v in tensors.items() if k.startswith(start)}
