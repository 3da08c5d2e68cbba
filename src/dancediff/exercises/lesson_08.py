"""Exercises of lesson 08: A memory for time."""

import torch

from dancediff.exercises.shared import unlike
from dancediff.nn.ssm import selective_scan


def _kernel(A, B, C, delta, length):
    k = torch.arange(length)[:, None]
    return (C * torch.exp(delta * A) ** k * delta * B).sum(-1)


def _kernel_cases() -> list[tuple]:
    A, B, C = torch.tensor([[-0.5, -2.0, -8.0], [1.0, 0.5, -2.0], [0.7, 1.0, 0.3]])
    return [(A, B, C, 0.1, 12), (A[:1], B[:1], C[:1], 0.5, 5)]


def _forget_at(f, k):
    delta = torch.full((f,), 1e-4)
    delta[k] = 10.0
    return delta


def _forgets_there_only(got, f, k) -> str:
    if wrong := unlike(got, (f,)):
        return wrong
    if (got < 0).any():
        return "a frame cannot last less than 0"
    fade = torch.exp(-got.double())
    before, there, behind = fade[1:k].prod(), fade[k], fade[k + 1 :].prod()
    for share, when in ((before, f"before frame {k}"), (behind, f"behind frame {k}")):
        if share < 0.9:
            return f"only {share:.0%} is left of what it knew {when}, expected 90 % or more"
    return "" if there < 1e-3 else f"{there:.1%} gets past frame {k}, expected less than 0.1 %"


def _each_remembers(tokens, n, memory):
    streams = tokens.reshape(-1, n, tokens.shape[-1]).transpose(0, 1)
    return memory(streams).transpose(0, 1).reshape(tokens.shape)


def _fading_memory(u):
    """Half of the past is left in the next frame (b, f, d)."""
    d, one = u.shape[-1], torch.ones(*u.shape[:2], 1)
    delta = torch.full_like(u, 0.6931)
    return selective_scan(u, delta, -torch.ones(d, 1), one, one, torch.zeros(d))


def _stream_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sizes = ((5, 3, 2), (4, 2, 1), (3, 5, 3))  # frames, dancers, width
    return [(torch.randn(f * n, d, generator=draw), n, _fading_memory) for f, n, d in sizes]


SPECS = {
    "08.1": {"spec": _kernel, "cases": _kernel_cases},
    "08.2": {
        "spec": _forget_at,
        "cases": lambda: [(90, 30), (40, 5)],
        "accepts": _forgets_there_only,
    },
    "08.4": {"spec": _each_remembers, "cases": _stream_cases},
}
