r"""Muon for matrices, AdamW for the rest, behind the face of one optimiser.

Read first: Jordan et al. 2024 (Muon); Liu et al. 2025 (Muon is scalable) section 2.2.

Symbols (one matrix)
    G        gradient; B its moving sum
    W        weights (a, b)
"""

from typing import Any

import torch

SMALLEST = 32  # rows and columns of a matrix that Muon moves


class MuonAdamW:
    r"""Move matrices in all directions alike, everything else as AdamW does.

    $$W \leftarrow (1 - \eta\lambda)\,W - 0.2\,\eta\sqrt{\max(a, b)}\;U V^\top,
      \qquad G + \mu B = U \Sigma V^\top$$

    The gradient of a matrix has few strong directions and many weak ones, and small batches drown
    the weak ones in noise; here each gets the same step. The factor makes the step as large as
    Adam's, so that both share one learning rate.

    Source: Muon, with the scale of Liu et al. eq. 4; `torch.optim.Muon` does the work.
    Differs from common use: matrices of input and output are included.

    >>> from torch import nn
    >>> weight, bias = nn.Parameter(torch.eye(64)), nn.Parameter(torch.zeros(64))
    >>> optimizer = MuonAdamW([{"params": [weight, bias]}], lr=0.1, weight_decay=0.0)
    >>> [type(part).__name__ for part in optimizer.parts]
    ['AdamW', 'Muon']
    >>> (weight.sum() + bias.sum()).backward()
    >>> optimizer.step()
    >>> bias[0].item() < 0
    True
    """

    def __init__(self, groups: list[dict], lr: float, weight_decay: float):
        """``groups``: dicts of ``params`` and, if wanted, their ``share`` of the learning rate."""
        matrices, rest = [], []
        for group in groups:
            share, params = group.get("share", 1.0), list(group["params"])
            large = {id(p) for p in params if p.ndim == 2 and min(p.shape) >= SMALLEST}
            moved = [p for p in params if id(p) in large]
            others = [p for p in params if id(p) not in large]
            matrices += [{"params": moved, "share": share}] if moved else []
            rest += [{"params": others, "share": share}] if others else []
        options: dict[str, Any] = {"lr": lr, "weight_decay": weight_decay}
        self.parts: list[torch.optim.Optimizer] = []
        if rest:
            self.parts.append(torch.optim.AdamW(rest, betas=(0.9, 0.99), fused=True, **options))
        if matrices:
            options |= {"momentum": 0.95, "adjust_lr_fn": "match_rms_adamw"}
            self.parts.append(torch.optim.Muon(matrices, **options))

    @property
    def param_groups(self) -> list[dict]:
        """Those of both, to set learning rates."""
        return [group for part in self.parts for group in part.param_groups]

    def zero_grad(self, set_to_none: bool = True) -> None:
        """Forget all gradients."""
        for part in self.parts:
            part.zero_grad(set_to_none=set_to_none)

    def step(self) -> None:
        """One update of all weights that have a gradient."""
        for part in self.parts:
            part.step()

    def state_dict(self) -> dict:
        """Both states as one; weights are counted on from the first part to the second."""
        state: dict[int, dict] = {}
        groups, before = [], 0
        for part in self.parts:
            one = part.state_dict()
            state |= {before + i: values for i, values in one["state"].items()}
            groups += one["param_groups"]
            before += _count(part)
        return {"state": state, "param_groups": groups}

    def load_state_dict(self, saved: dict) -> None:
        """Take a state back that `state_dict` gave.

        Raises: KeyError when it belongs to weights that are not here.
        """
        before, state = 0, dict(saved["state"])
        for part in self.parts:
            own = {i: state.pop(before + i) for i in range(_count(part)) if before + i in state}
            part.load_state_dict({"state": own, "param_groups": part.state_dict()["param_groups"]})
            before += _count(part)
        if state:
            raise KeyError(f"no weight has the numbers {sorted(state)}")


def _count(part: torch.optim.Optimizer) -> int:
    return sum(len(group["params"]) for group in part.param_groups)
