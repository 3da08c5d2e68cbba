"""Solutions of lesson 05."""

# %% 05.1
# vel compares frames, dist compares dancers: what is the same for all goes out of both. contact
# does not know the truth; nobody slides, so it is zero. Only a loss of places notices.
notices = {"simple": True, "vel": False, "fk": True, "contact": False, "dist": False}


# %% 05.2
# An offset is wrong by the difference of the two dancers' errors, so a shift of the whole group
# costs nothing. Each pair counts once, and nobody with themselves.
import torch


def distance_loss(p_hat, p):
    e = p_hat - p
    i, j = torch.triu_indices(len(e), len(e), 1)
    return (e[i] - e[j]).square().mean()


# %% 05.3
# A difference of two frames of one dancer forgets where that dancer stands. So each may be put
# anywhere, as long as the steps stay; the mean over pairs of dancers (exercise 05.2) would notice.
# Nobody is over 5 m to the right of another, so after 11 m any two are 6 m apart or more.
def fool(p):
    aside = p.new_tensor([[11.0 * k, 0, 0] for k in range(len(p))])  # metres to the right
    return p + aside[:, None]


# %% 05.4
# Each block reads normalised tokens, and what it finds is scaled and shifted before it is added: so
# a layer that has learned nothing would leave h as it is. Only the source of K and V tells cross-
# from self-attention.
import math

import torch.nn.functional as F


def layer(h, memory, c, W):
    def att(x, m, w):
        Q, K, V = x @ w[0], m @ w[1], m @ w[2]
        return (Q @ K.mT / math.sqrt(Q.shape[-1])).softmax(-1) @ V

    blocks = [
        lambda x: att(x, x, W["self"]),
        lambda x: att(x, memory, W["cross"]),
        lambda x: F.gelu(x @ W["in"]) @ W["out"],
    ]
    for k, block in enumerate(blocks):
        gamma, beta = (F.mish(c) @ W["film"][k]).chunk(2)
        h = h + (1 + gamma) * block(F.layer_norm(h, h.shape[-1:])) + beta
    return h
