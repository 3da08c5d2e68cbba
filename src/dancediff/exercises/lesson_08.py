"""Exercises of lesson 08: A memory for time."""

import torch

from dancediff.exercises.exercise import Exercise
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


EXERCISES = {
    "08.1": Exercise(
        "the memory as a kernel",
        _kernel,
        "follow one pulse: it enters as delta * B, is multiplied by exp(delta * A) once per frame "
        "(not in its own frame), and C reads the sum of all states",
        _kernel_cases,
    ),
    "08.2": Exercise(
        "forget on command",
        _forget_at,
        "in frame i everything older is multiplied by exp(-delta[i]): next to 1 where the frame is "
        "short, next to 0 where it is long",
        lambda: [(90, 30), (40, 5)],
        _forgets_there_only,
    ),
    "08.3": Exercise(
        "four times as long",
        {"Python loop": 4, "the same scan in chunks": 4, "self-attention": 16},
        "a scan does the same work for every frame; attention does some for every pair of frames",
    ),
    "08.4": Exercise(
        "whose memory?",
        _each_remembers,
        "make a batch of n streams, (n, f, d), let the memory run along the frames, and put the "
        "tokens back as they came; tokens.reshape(f, n, d) is frame by frame",
        _stream_cases,
    ),
}
