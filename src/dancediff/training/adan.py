r"""Adan: Adam with a look at how the gradient changes.

Read first: Xie et al. 2022 (Adan) algorithm 1.

Symbols (one entry each per weight)
    g       gradient of this step; d = g minus that of the step before (0 at first)
    m, v    moving averages of g and of d
    n       moving average of the square of g + beta_2 d
"""

import torch


class Adan(torch.optim.Optimizer):
    r"""Step along the gradient and along its change, both scaled by their size.

    $$\theta \leftarrow \frac{\theta - \eta\,(\hat m + \beta_2 \hat v) / (\sqrt{\hat n} + \epsilon)}
      {1 + \eta\lambda}$$

    Source: Adan algorithm 1; EDGE, TCDiff and TCDiff++'s code use it with lr 4e-4 and weight decay
    0.02. Betas are shares kept, as in Adam.  Differs: averages are corrected for their start at
    zero, as in the authors' own code; the copy in EDGE's line of work leaves that out.

    >>> weight = torch.nn.Parameter(torch.tensor([1.0, -2.0]))
    >>> optimizer = Adan([weight], lr=0.1, weight_decay=0.0)
    >>> weight.sum().backward()
    >>> optimizer.step()                    # the first step is lr along the gradient's sign
    >>> [round(value, 4) for value in weight.tolist()]
    [0.9, -2.1]
    """

    def __init__(
        self, params, lr: float = 4e-4, betas=(0.98, 0.92, 0.99), eps=1e-8, weight_decay=0.02
    ):
        """``params``: weights, or groups of them with options of their own."""
        options = {"lr": lr, "betas": betas, "eps": eps, "weight_decay": weight_decay}
        super().__init__(params, options)

    @torch.no_grad()
    def step(self, closure=None):
        """One update of all weights that have a gradient."""
        if closure is not None:
            raise ValueError("closure is not supported; compute the gradients before step()")
        for group in self.param_groups:
            for weight in group["params"]:
                if weight.grad is not None:
                    self._update(weight, group)

    def _update(self, weight, group: dict) -> None:
        state, g = self.state[weight], weight.grad
        if not state:
            state["step"] = torch.tensor(0.0)
            state |= {name: torch.zeros_like(weight) for name in ("m", "v", "n")}
            state["last"] = g.clone()
        d = g - state["last"]
        state["last"].copy_(g)
        state["step"] += 1
        look_ahead = g + group["betas"][1] * d
        corrected = []
        for name, value, beta in zip("mvn", (g, d, look_ahead**2), group["betas"], strict=True):
            state[name].lerp_(value, 1 - beta)
            corrected.append(state[name] / (1 - beta ** state["step"].item()))
        m, v, n = corrected
        direction = (m + group["betas"][1] * v) / (n.sqrt() + group["eps"])
        weight.sub_(group["lr"] * direction).div_(1 + group["lr"] * group["weight_decay"])
