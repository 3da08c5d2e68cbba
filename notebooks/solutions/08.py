"""Solutions of lesson 08."""

# %% 08.1
# A pulse is written once, as delta * B, decays once per frame and is read by C. If A, B and C never
# change, every pulse leaves this same trace, so the scan is a convolution with it.
import torch


def kernel(A, B, C, delta, length):
    k = torch.arange(length)[:, None]
    return (C * torch.exp(k * delta * A) * delta * B).sum(-1)


# %% 08.2
# A frame that lasts long fades all that was before it; one that lasts next to nothing leaves it.
# Delta also says how much of the news is written, so frame k itself goes in with full weight.
from torch import full


def deltas(f, k):
    delta = full((f,), 1e-4)
    delta[k] = 10.0
    return delta


# %% 08.3
# Loop and chunks look at each frame once (and at its chunk, whose length does not change), so four
# times the frames are four times the work. Attention compares pairs: four times four.
times_longer = {"Python loop": 4, "the same scan in chunks": 4, "self-attention": 16}


# %% 08.4
# In one long stream a dancer's memory is full of the others, and fades n times as fast, since the
# next token is not the dancer's own next frame. As a batch of streams each keeps its own past.
def remember(tokens, n, memory):
    f = len(tokens) // n
    streams = tokens.reshape(f, n, -1).transpose(0, 1)  # (n, f, d)
    return memory(streams).transpose(0, 1).reshape(f * n, -1)


# %% 08.5
# All that a later frame can know of earlier ones is in h, apart from three inputs that the
# convolution still has to see. So the work for a frame is the same after a second and an hour.
import torch.nn.functional as F
from torch import cat


def next_frame(x, past, h, block):
    u, z = block.in_proj(x).chunk(2, dim=-1)
    seen = cat([past, u[:, None]], dim=1)  # (n, 4, e)
    u = F.silu((seen * block.conv.weight[:, 0].T).sum(1) + block.conv.bias)
    sizes = block.dt_proj.in_features, block.d_state, block.d_state
    dt, B, C = block.x_proj(u).split(sizes, dim=-1)
    delta = F.softplus(block.dt_proj(dt))
    fade = (delta[..., None] * -block.A_log.exp()).exp()
    h = fade * h + (delta * u)[..., None] * B[:, None]
    y = (h * C[:, None]).sum(-1) + block.D_skip * u
    return block.out_proj(y * F.silu(z)), seen[:, 1:], h
