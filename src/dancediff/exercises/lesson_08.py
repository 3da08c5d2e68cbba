"""Exercises of lesson 08: A memory for time."""

import torch
import torch.nn.functional as F

from dancediff.exercises.shared import unlike, unlike_part
from dancediff.nn.ssm import MambaBlock, selective_scan


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


def _next_frame(x, past, h, block):
    u, z = block.in_proj(x).chunk(2, dim=-1)
    heard = torch.cat([past, u[:, None]], dim=1)
    u = F.silu(torch.einsum("nfd,df->nd", heard, block.conv.weight[:, 0]) + block.conv.bias)
    sizes = block.dt_proj.in_features, block.d_state, block.d_state
    dt, B, C = block.x_proj(u).split(sizes, dim=-1)
    delta = F.softplus(block.dt_proj(dt))
    fade = torch.exp(-delta[..., None] * block.A_log.exp())
    h = fade * h + (delta * u)[..., None] * B[:, None]
    y = (h * C[:, None]).sum(-1) + block.D_skip * u
    return block.out_proj(y * F.silu(z)), heard[:, 1:], h


def _live_cases() -> list[tuple]:
    """Dancers who have just begun, and others who have not; blocks of several sizes."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for n, d, states, begun in ((2, 4, 3, 0), (3, 20, 2, 1), (5, 6, 4, 1)):
        with torch.random.fork_rng(devices=[]):  # the lesson's own draws stay as they are
            block = MambaBlock(d, d_state=states).requires_grad_(requires_grad=False)
        for weights in block.parameters():
            weights.copy_(0.6 * torch.randn(weights.shape, generator=draw))
        sizes = ((n, d), (n, 3, 2 * d), (n, 2 * d, states))
        x, past, h = (torch.randn(*size, generator=draw) for size in sizes)
        cases.append((x, begun * past, begun * h, block))
    return cases


def _goes_on(got, x, past, h, block) -> str:
    out, kept, state = got
    right = _next_frame(x, past, h, block)
    parts = {"past": (kept, right[1]), "h": (state, right[2]), "out": (out, right[0])}
    return next(filter(None, (unlike_part(name, *both) for name, both in parts.items())), "")


SPECS = {
    "08.1": {"spec": _kernel, "cases": _kernel_cases},
    "08.2": {
        "spec": _forget_at,
        "cases": lambda: [(90, 30), (40, 5)],
        "accepts": _forgets_there_only,
    },
    "08.4": {"spec": _each_remembers, "cases": _stream_cases},
    "08.5": {"spec": _next_frame, "cases": _live_cases, "accepts": _goes_on},
}
