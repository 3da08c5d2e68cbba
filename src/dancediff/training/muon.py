r"""Muon for matrices, AdamW for the rest, behind the face of one optimiser.

Read first: Jordan et al. 2024 (Muon); Liu et al. 2025 (Muon is scalable) section 2.2.

Symbols (one matrix)
    G        gradient; B its moving mean
    W        weights (a, b)
    U, V     singular vectors of (1 - mu) G + mu B, in the columns of a matrix each
"""

from typing import Any

import torch
from torch import Tensor

from dancediff.nn.precision import fastest_dtype

SMALLEST = 32  # rows and columns of a matrix that Muon moves


def orthogonalized(G: Tensor, *, ns_coefficients, ns_steps: int, eps: float, dtype) -> Tensor:
    r"""A matrix with the singular vectors of G and singular values near 1.

    $$X_0 = G / \lVert G \rVert_F, \qquad
      X_{k+1} = a X_k + b\,(X_k X_k^\top) X_k + c\,(X_k X_k^\top)^2 X_k$$

    Source: Jordan et al. 2024, five steps of Newton and Schulz; values end within 0.7 to 1.2.
    Differs from `torch.optim.Muon`: it may compute with all digits.

    Shapes: G (a, b) -> (a, b) in ``dtype``.

    >>> G = torch.diag(torch.tensor([1.0, 0.1]))
    >>> how = {"ns_coefficients": (3.4445, -4.775, 2.0315), "ns_steps": 5, "eps": 1e-7}
    >>> orthogonalized(G, **how, dtype=torch.float32).diag()
    tensor([0.7020, 0.7087])
    """
    a, b, c = ns_coefficients
    wide = len(G) <= G.shape[1]
    X = G.to(dtype) if wide else G.to(dtype).T  # fewer rows than columns: the smaller product
    X = X / X.norm().clamp(min=eps)
    for _ in range(ns_steps):
        XXt = X @ X.T
        X = torch.addmm(X, torch.addmm(XXt, XXt, XXt, beta=b, alpha=c), X, beta=a)
    return X if wide else X.T


class Muon(torch.optim.Muon):
    """`torch.optim.Muon` that computes with the digits that are faster on this processor.

    Torch's takes bfloat16 everywhere. A processor without it needs 45 times as long as with
    float32: 19 of the 24 seconds of a step of TCDiff++. Only the scale "match_rms_adamw" is here.
    """

    def __init__(self, groups: list[dict], **options):
        super().__init__(groups, adjust_lr_fn="match_rms_adamw", **options)
        self.dtype = fastest_dtype(self.param_groups[0]["params"][0].device.type)

    @torch.no_grad()
    def step(self, closure: Any = None) -> Any:
        """One update of all matrices that have a gradient; a closure is not called."""
        for group in self.param_groups:
            how = {name: group[name] for name in ("ns_coefficients", "ns_steps", "eps")}
            for W in group["params"]:
                if W.grad is None:
                    continue
                if "momentum_buffer" not in self.state[W]:
                    self.state[W]["momentum_buffer"] = torch.zeros_like(W.grad)
                B = self.state[W]["momentum_buffer"].lerp_(W.grad, 1 - group["momentum"])
                G = W.grad.lerp(B, group["momentum"])  # Nesterov's
                scale = 0.2 * max(W.shape) ** 0.5
                W.mul_(1 - group["lr"] * group["weight_decay"])
                W.add_(orthogonalized(G, **how, dtype=self.dtype), alpha=-group["lr"] * scale)


class MuonAdamW:
    r"""Move matrices in all directions alike, everything else as AdamW does.

    $$W \leftarrow (1 - \eta\lambda)\,W - 0.2\,\eta\sqrt{\max(a, b)}\;U V^\top,
      \qquad (1 - \mu)\,G + \mu B = U \Sigma V^\top$$

    The gradient of a matrix has few strong directions and many weak ones, and small batches drown
    the weak ones in noise; here each gets the same step. The factor makes the step as large as
    Adam's, so that both share one learning rate.

    Source: Muon, with the scale of Liu et al. eq. 4.
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
            self.parts.append(Muon(matrices, momentum=0.95, **options))

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
