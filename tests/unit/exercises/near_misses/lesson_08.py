"""Plausible wrong answers to the exercises of lesson 08: A memory for time."""

import torch

NEAR_MISSES = {
    "08.1": [
        lambda A, B, C, delta, length: (
            C * torch.exp(delta * A) ** torch.arange(1, length + 1)[:, None] * delta * B
        ).sum(-1),  # forgets in the pulse's own frame
        lambda A, B, C, delta, length: (
            C * torch.exp(delta * A) ** torch.arange(length)[:, None] * B
        ).sum(-1),  # no delta when it is written
        lambda A, B, C, delta, length: (C * A ** torch.arange(length)[:, None] * delta * B).sum(
            -1
        ),  # the rate instead of what a frame leaves
        lambda A, B, C, delta, length: (
            C * torch.exp(delta * A) ** torch.arange(length)[:, None] * delta * B
        ),  # one kernel for every state
        lambda A, B, C, delta, length: (
            (C * torch.exp(delta * A) ** torch.arange(length)[:, None] * delta * B).sum(-1).flip(0)
        ),
        lambda A, B, C, delta, length: (
            C * torch.exp(-delta * A) ** torch.arange(length)[:, None] * delta * B
        ).sum(-1),  # it grows
        lambda A, B, C, delta, length: (
            C * torch.exp(delta * A) ** torch.arange(length)[:, None] * delta * B
        ).mean(-1),
        lambda A, B, C, delta, length: (
            C * (1 + delta * A) ** torch.arange(length)[:, None] * delta * B
        ).sum(-1),  # Euler's step
    ],
    "08.2": [
        lambda f, k: torch.full((f,), 10.0),  # forgets always
        lambda f, k: torch.full((f,), 1e-4),  # never
        lambda f, k: torch.where(torch.arange(f) < k, 10.0, 1e-4),  # too early
        lambda f, k: torch.where(torch.arange(f) < k, 1e-4, 10.0),  # from then on
        lambda f, k: torch.where(torch.arange(f) == k, 1.0, 1e-4),  # a third is left
        lambda f, k: torch.where(torch.arange(f) == k + 1, 10.0, 1e-4),  # a frame late
        lambda f, k: torch.where(torch.arange(f) == k, 10.0, -1e-4),
    ],
    "08.3": [
        {"Python loop": 4, "the same scan in chunks": 4, "self-attention": 4},
        {"Python loop": 16, "the same scan in chunks": 4, "self-attention": 16},
        {"Python loop": 4, "the same scan in chunks": 1, "self-attention": 16},
        {"Python loop": 4, "the same scan in chunks": 4, "self-attention": 256},
    ],
    "08.4": [
        lambda tokens, n, memory: memory(tokens[None])[0],  # one stream, as the released code
        lambda tokens, n, memory: memory(tokens.reshape(n, -1, tokens.shape[-1])).reshape(
            tokens.shape
        ),  # dancer by dancer, which they are not
        lambda tokens, n, memory: memory(tokens.reshape(-1, n, tokens.shape[-1])).reshape(
            tokens.shape
        ),  # along the row instead of along time
        lambda tokens, n, memory: memory(
            tokens.reshape(-1, n, tokens.shape[-1]).transpose(0, 1)
        ).reshape(tokens.shape),  # not put back
        lambda tokens, n, memory: memory(tokens.reshape(-1, n, tokens.shape[-1]).transpose(0, 1)),
        lambda tokens, n, memory: (
            memory(tokens.reshape(-1, n, tokens.shape[-1]).transpose(0, 1).flip(1))
            .transpose(0, 1)
            .reshape(tokens.shape)
        ),  # from behind
        lambda tokens, n, memory: tokens,
    ],
}
