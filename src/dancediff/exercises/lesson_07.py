"""Exercises of lesson 07: Who stands where?

Read first: notebook 07.
"""

import torch

from dancediff.exercises.shared import NUMBERS, unlike, unlike_part
from dancediff.extensions.preconditioning import dct_matrix


def _nameless(h):
    return h + h.mean(1, keepdim=True)


def _crowds() -> list[tuple]:
    """Three groups each: one, the same in another order, the same with one dancer replaced."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for order in ([2, 0, 1], [1, 3, 0, 2]):
        h, new = (torch.randn(n, 5, 4, generator=draw) for n in (len(order), 1))
        for far in (0, 4):  # who is changed may lie below all others: a maximum forgets such a one
            h[0], new = h[0] - far, new - far
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


def _fit(x, C):
    order = x[..., 0].argsort(1)
    x = x.take_along_dim(order[..., None], 1)
    place = x[..., 0].mean(0)
    way = place[x[..., -1].argsort(1).argsort(1)] - place
    gone = x - place[:, None]
    progress = (way[..., None] * gone).sum((0, 1)) / way.square().sum()
    waves = (gone - way[..., None] * progress) @ C.T
    size, basis = torch.linalg.eigh(torch.einsum("bnf,bmf->fnm", waves, waves) / len(x))
    return place, progress, basis, size.clamp_min(0).sqrt()


def _group_cases() -> list[tuple]:
    """Groups that change places while they drift together; rows in any order."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for groups, n, f in ((8, 3, 12), (6, 2, 20), (9, 4, 10)):
        start, drift, rest = (
            torch.randn(groups, *size, generator=draw) for size in ((n,), (), (n, f))
        )
        start = (1.2 * torch.arange(n) + 0.15 * start).sort(1).values - 0.6 * n
        orders = [torch.randperm(n, generator=draw) for _ in range(groups)]
        done = torch.linspace(0, 1, f) ** 2
        goal = start.take_along_dim(torch.stack(orders), 1)
        x = start[..., None] + (goal - start)[..., None] * done + 0.05 * rest
        x += 0.4 * drift[:, None, None] * torch.linspace(0, 1, f)
        rows = [torch.randperm(n, generator=draw) for _ in range(groups)]
        cases.append((x.take_along_dim(torch.stack(rows)[..., None], 1), dct_matrix(f)))
    return cases


def _is_prior(got, x, C) -> str:
    place, progress, basis, std = got
    right = _fit(x, C)
    for name, mine, want in zip(("place", "progress"), (place, progress), right, strict=False):
        if wrong := unlike_part(name, mine, want):
            return wrong
    for name, mine, want in zip(("basis", "std"), (basis, std), right[2:], strict=True):
        if wrong := unlike(mine, want.shape, NUMBERS):
            return f"{name}: {wrong}"
    (U, size), (basis, std) = (torch.as_tensor(v).to(x) for v in (basis, std)), right[2:]
    if not torch.allclose(U.mT @ U, torch.eye(U.shape[-1]), atol=1e-3):
        return "the columns of basis are not of length 1 and at right angles to each other"
    mine, want = (B @ (s.square()[..., None] * B.mT) for B, s in ((U, size), (basis, std)))
    off = (mine - want).abs().amax((1, 2)) / want.abs().amax((1, 2))
    worst = int(off.argmax())
    if off[worst] < 0.01:
        return ""
    return f"at frequency {worst}, basis and std are not those of how groups leave mu"


SPECS = {
    "07.1": {"spec": _nameless, "cases": _crowds, "accepts": _mixes_without_order},
    "07.3": {"spec": _ranks, "cases": _ranks_cases},
    "07.4": {"spec": _mark, "cases": _token_cases},
    "07.5": {"spec": _fit, "cases": _group_cases, "accepts": _is_prior},
}
