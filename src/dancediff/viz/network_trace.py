"""What happens inside a network in one call: which parts run, and the shapes between them.

Read first: `dancediff.viz.network_picture`, which draws it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.papers.lodge.model import Lodge
from dancediff.papers.tcdiffpp.model import TCDiffPP

DANCERS = 3  # of the group that TCDiff++ is shown


@dataclass(frozen=True)
class Call:
    """The first call of a part: its shapes without the batch."""

    into: tuple[tuple[int, ...], ...]
    out: tuple[tuple[int, ...], ...]
    weights: int


def trace(network: nn.Module, run: Callable[[], Any]) -> dict[str, Call]:
    """Every part of a network that ``run`` calls, by its name in `torch.nn.Module.named_modules`.

    They stand in the order in which their first calls end.

    >>> network = nn.Sequential(nn.Linear(4, 2), nn.ReLU())
    >>> calls = trace(network, lambda: network(torch.zeros(1, 4)))
    >>> calls["0"]
    Call(into=((4,),), out=((2,),), weights=10)
    """
    entered: dict[str, tuple[tuple[int, ...], ...]] = {}
    calls: dict[str, Call] = {}

    def enter(name: str, part: nn.Module, given: tuple) -> None:
        entered.setdefault(name, _shapes(given))

    def leave(name: str, part: nn.Module, given: tuple, made: Any) -> None:
        weights = sum(p.numel() for p in part.parameters())
        calls.setdefault(name, Call(entered[name], _shapes(made), weights))

    hooks = []
    training = [part for part in network.modules() if part.training]
    network.eval()  # dropout would draw random numbers
    for name, part in network.named_modules():
        hooks.append(part.register_forward_pre_hook(partial(enter, name)))
        hooks.append(part.register_forward_hook(partial(leave, name)))
    try:
        with torch.no_grad():
            run()
    finally:
        for hook in hooks:
            hook.remove()
        for part in training:
            part.training = True
    return calls


def _shapes(values: Any) -> tuple[tuple[int, ...], ...]:
    """Of all tensors in a value or a tuple of values; the first axis, the batch, is left out."""
    every = values if isinstance(values, tuple | list) else (values,)
    return tuple(tuple(v.shape[1:]) for v in every if isinstance(v, Tensor))


def call_tcdiffpp(network: TCDiffPP) -> None:
    """Ask for one guess: three dancers, a full segment, a middle noise level."""
    c, device = network.config, network.device
    n = min(DANCERS, c.max_dancers)
    x_t = torch.zeros(1, n, c.num_frames, c.motion_dim, device=device)
    music = torch.zeros(1, c.num_frames, c.music_dim, device=device)
    swap = torch.arange(n, device=device)[None]
    network(x_t, _middle(c.num_steps, device), Conditions(music, swap))


def call_lodge(network: Lodge) -> None:
    """Ask each stage for one guess."""
    stages = (
        (network.global_stage, network.config.global_stage.music_frames),
        (
            network.local_stage,
            network.config.local_stage.num_frames,
        ),
    )
    for stage, music_frames in stages:
        c, device = stage.config, stage.device
        x_t = torch.zeros(1, len(stage.frames), c.motion_dim, device=device)
        music = torch.zeros(1, music_frames, c.music_dim, device=device)
        style = None
        if stage.style is not None:
            genre = torch.zeros(1, dtype=torch.long, device=device)
            style = stage.style(genre, torch.zeros(1, stage.style.noise, device=device))
        stage(x_t, _middle(c.num_steps, device), Conditions(music, style=style))


def _middle(num_steps: int, device) -> Tensor:
    return torch.tensor([num_steps // 2], device=device)
