"""Plausible wrong answers to the exercises of lesson 05: A denoiser that listens."""

from functools import partial

import torch
import torch.nn.functional as F

from dancediff.exercises import EXERCISES


def layer(h, memory, c, W, *, wrong):
    """The layer of 05.4 with one thing wrong."""

    def norm(x):
        return F.layer_norm(x, x.shape[-1:])

    def attend(x, m, maps):
        Q, K, V = (y @ w for y, w in zip((x, m, m), maps, strict=True))
        weights = Q @ K.mT / (1 if wrong == "no square root" else x.shape[-1] ** 0.5)
        return weights.softmax(0 if wrong == "softmax over queries" else 1) @ V

    def act(x):
        return F.relu(x) if wrong == "ReLU" else F.gelu(x)

    given = norm(memory) if wrong == "memory normalised" else memory
    blocks = [
        lambda x: attend(x, h if wrong == "keys of h as it is" else x, W["self"]),
        lambda x: attend(x, x if wrong == "no cross-attention" else given, W["cross"]),
        lambda x: act(x @ W["in"]) @ W["out"],
    ]
    films = list(W["film"])
    if wrong == "order of blocks":
        blocks, films = blocks[::-1], films[::-1]
    for block, film in zip(blocks, films, strict=True):
        gamma, beta = ((c if wrong == "no Mish" else F.mish(c)) @ film).chunk(2)
        if wrong == "shift and scale exchanged":
            gamma, beta = beta, gamma
        made = block(h if wrong == "no LN" else norm(h))
        made = (gamma if wrong == "no 1 +" else 1 + gamma) * made + beta
        h = made if wrong == "no residual" else h + made
    return h


def film_around_everything(h, memory, c, W):
    """FiLM acts on h, too."""
    plain = {**W, "film": torch.zeros_like(W["film"])}
    gamma, beta = (F.mish(c) @ W["film"][0]).chunk(2)
    return (1 + gamma) * layer(h, memory, c, plain, wrong="") + beta


SLIPS = (
    "no square root",
    "softmax over queries",
    "ReLU",
    "memory normalised",
    "keys of h as it is",
    "no cross-attention",
    "order of blocks",
    "no Mish",
    "shift and scale exchanged",
    "no LN",
    "no 1 +",
    "no residual",
)

NEAR_MISSES = {
    "05.1": [
        {"simple": True, "vel": True, "fk": True, "contact": True, "dist": True},
        {"simple": True, "vel": False, "fk": True, "contact": False, "dist": True},
        {"simple": True, "vel": False, "fk": True, "contact": True, "dist": False},
        {"simple": True, "vel": False, "fk": True},
    ],
    "05.2": [
        lambda p_hat, p: (p_hat - p).square().mean(),  # places, not offsets
        lambda p_hat, p: (p_hat - p).diff(dim=0).square().mean(),  # neighbours only
        lambda p_hat, p: (p_hat - p).diff(dim=1).square().mean(),  # time, as the released code
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().mean(),  # with herself
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().sum(),
        lambda p_hat, p: 3 * EXERCISES["05.2"].spec(p_hat, p),  # the sum over x, y, z
        lambda p_hat, p: EXERCISES["05.2"].spec(p_hat, p).sqrt(),
        lambda p_hat, p: (p_hat - p).var(dim=0).mean(),  # half of it
        lambda p_hat, p: (  # distances instead of offsets
            (torch.pdist(p_hat[:, 0]) - torch.pdist(p[:, 0])).square().mean()
        ),
        lambda p_hat, p: EXERCISES["05.2"].spec(p_hat[..., [0, 2]], p[..., [0, 2]]),  # no height
    ],
    "05.3": [
        lambda p: p,
        lambda p: p + 10,  # all aside: the distances are right
        lambda p: 10 * p,  # steps are ten times as long
        lambda p: p[:, torch.randperm(p.shape[1], generator=torch.Generator().manual_seed(0))],
        lambda p: torch.cat([p[:1] + 10, p[1:]]),  # the others stand well
        lambda p: p + 0.1 * torch.arange(len(p))[:, None, None],  # too little
        lambda p: p[0],
        lambda p: p + 0.6 * torch.arange(len(p))[:, None, None] * torch.eye(3)[0],  # only in a row
        lambda p: p + 0.6 * torch.arange(len(p))[:, None, None] * torch.eye(3)[2],
        lambda p: p + 4 * torch.arange(len(p))[:, None, None] * torch.eye(3)[0],  # past each other
        lambda p: p + 10 * torch.arange(len(p))[:, None, None] * torch.eye(3)[0],  # the same at 5 m
        lambda p: p.flip(0),  # exchanged: steps change
        lambda p: p + 10 * torch.linspace(0, 1, p.shape[1])[:, None],  # all drift
    ],
    "05.4": [*(partial(layer, wrong=slip) for slip in SLIPS), film_around_everything],
}
