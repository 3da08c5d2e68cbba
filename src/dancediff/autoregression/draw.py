"""Draw the next code of each dancer from the logits of a network."""

from collections.abc import Sequence

import torch
from torch import Tensor


def draw(
    logits: Tensor, generators: Sequence[torch.Generator], *, temperature: float, top_k: int
) -> Tensor:
    r"""One code a row, from the ``top_k`` most likely ones: $p_i \propto e^{l_i / \tau}$.

    ``top_k=1`` takes the most likely one, as the papers do. Every row has a generator (of the CPU)
    of its own, so that a dancer does not depend on who else dances.

    Shapes: logits (n, k) -> codes (n,).

    >>> logits = torch.tensor([[0.0, 5.0, 1.0], [3.0, 0.0, 1.0]])
    >>> draw(logits, [torch.Generator()] * 2, temperature=1.0, top_k=1).tolist()
    [1, 0]
    """
    best, codes = (logits.detach().float().cpu() / temperature).topk(min(top_k, logits.shape[-1]))
    chosen = [
        torch.multinomial(row.softmax(-1), 1, generator=g)
        for row, g in zip(best, generators, strict=True)
    ]
    return codes.gather(-1, torch.stack(chosen))[:, 0].to(logits.device)
