"""Exercises of lesson 07: Who stands where?"""

import torch

from dancediff.exercises.shared import unlike


def _nameless(h):
    return h + h.mean(1, keepdim=True)


def _crowds() -> list[tuple]:
    """Three groups each: one, the same in another order, the same with one dancer replaced."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for order in ([2, 0, 1], [1, 3, 0, 2]):
        h, new = (torch.randn(n, 5, 4, generator=draw) for n in (len(order), 1))
        cases.append((torch.stack([h, h[order], torch.cat([new, h[1:]])]),))
    return cases


def _mixes_without_order(got, h) -> str:
    if wrong := unlike(got, h.shape):
        return wrong
    order = [(h[0] == dancer).all(-1).all(-1).nonzero().item() for dancer in h[1]]
    if not torch.allclose(got[1], got[0][order], atol=1e-4):
        return "the same dancers in another order get other tokens"
    added = got - h
    if added.abs().max() > 1e-4 and torch.allclose(added, added.mean().expand_as(h), atol=1e-4):
        return "all tokens of all groups get the same number added; groups do not hear each other"
    changed = (got[2, 1:] - got[0, 1:]).abs().amax((1, 2))
    if (changed < 1e-4).any():
        return f"dancer {1 + int(changed.argmin())} does not change when dancer 0 is replaced"
    return ""


def _ranks(root):
    return root[:, 0, 0].argsort(stable=True).argsort()


def _ranks_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    root = torch.randn(4, 20, 3, generator=draw)
    root[:, 0, 0] = torch.tensor([0.5, 1.5, -1.5, -0.5])  # its order is not its own inverse
    root[:, -1, 0] = torch.tensor([-1.5, 0.5, -0.5, 1.5])
    return [(root,), (root[:3],)]


def _mark(tokens, table):
    return tokens + table.repeat(len(tokens) // len(table), 1)


def _token_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((4, 3, 2), (3, 2, 5), (6, 5, 1), (7, 1, 3))  # frames, dancers, width
    return [
        (torch.randn(f * n, d, generator=draw), torch.randn(n, d, generator=draw))
        for f, n, d in sizes
    ]


SPECS = {
    "07.1": {"spec": _nameless, "cases": _crowds, "accepts": _mixes_without_order},
    "07.3": {"spec": _ranks, "cases": _ranks_cases},
    "07.4": {"spec": _mark, "cases": _token_cases},
}
