"""Plausible wrong answers to the exercises of lesson 08: A memory for time."""

from functools import partial

import torch
import torch.nn.functional as F


def live(x, past, h, block, wrong):
    """Exercise 08.5 with one mistake."""
    u, z = block.in_proj(x).chunk(2, dim=-1)
    if wrong == "gate first":
        u, z = z, u
    seen = torch.cat([past, u[:, None]], 1)
    if wrong == "newest first":
        seen = torch.cat([u[:, None], past], 1)
    kept = seen[:, :3] if wrong == "the oldest kept" else seen[:, 1:]
    weight = block.conv.weight[:, 0].T
    heard = (seen * (weight.flip(0) if wrong == "kernel backwards" else weight)).sum(1)
    u = heard + (0 if wrong == "no bias" else block.conv.bias)
    u = u if wrong == "no SiLU" else F.silu(u)
    if wrong == "behind the convolution":
        kept = torch.cat([past[:, 1:], u[:, None]], 1)
    s = block.d_state
    dt, B, C = block.x_proj(u).split([block.dt_proj.in_features, s, s], -1)
    if wrong == "read for write":
        B, C = C, B
    delta = block.dt_proj(dt)
    delta = delta.exp() if wrong == "exp for softplus" else F.softplus(delta)
    rate = block.A_log if wrong == "log" else block.A_log.exp()
    fade = torch.exp(-delta[..., None] * rate)
    new = (u if wrong == "no delta" else delta * u)[..., None] * B[:, None]
    after = fade * (h + new) if wrong == "fades at once" else fade * h + new
    read = h if wrong == "read before it is written" else after
    y = (read * C[:, None]).sum(-1)
    y = y if wrong == "no D" else y + block.D_skip * u
    y = y if wrong == "no gate" else y * F.silu(z)
    return block.out_proj(y), kept, h if wrong == "the old state" else after


LIVE_MISTAKES = (
    "gate first",
    "newest first",
    "the oldest kept",  # the window does not move on
    "kernel backwards",
    "no bias",
    "no SiLU",
    "behind the convolution",  # it would be convolved twice
    "read for write",
    "exp for softplus",
    "log",  # the rate is its exponential
    "no delta",
    "fades at once",  # the new frame, too
    "read before it is written",
    "no D",
    "no gate",
    "the old state",
)


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
    "08.5": [
        *(partial(live, wrong=wrong) for wrong in LIVE_MISTAKES),
        lambda x, past, h, block: live(x, past, h, block, "")[0],
        lambda x, past, h, block: (block(x[:, None])[:, 0], past, h),  # as if nothing had been
    ],
}
