"""Plausible wrong answers to the exercises of lessons 05 to 10."""

import torch

NEAR_MISSES = {
    "05.1": [
        lambda p_hat, p: (p_hat - p).square().mean(),  # places, not offsets
        lambda p_hat, p: (p_hat - p).diff(dim=0).square().mean(),  # neighbours only
        lambda p_hat, p: (p_hat - p).diff(dim=1).square().mean(),  # time, as the released code
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().mean(),  # with herself
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().sum(),
    ],
    "06.1": [
        lambda net, x_t, w: net(x_t, music=True) + w * net(x_t, music=False),
        lambda net, x_t, w: w * net(x_t, music=True),
        lambda net, x_t, w: (1 + w) * net(x_t, music=True) - w * net(x_t, music=False),
        lambda net, x_t, w: (1 - w) * net(x_t, music=True) + w * net(x_t, music=False),
    ],
    "07.1": [
        lambda root: root[:, 0, 0].argsort(),  # who stands k-th, not which k
        lambda root: root[:, -1, 0].argsort().argsort(),  # at the last frame
        lambda root: root[:, 0, 2].argsort().argsort(),  # in depth
        lambda root: root[:, 0, 0].argsort(descending=True).argsort(),
        lambda root: root[:, 0, 0].argsort().argsort() + 1,
        lambda root: root[:, :, 0].argsort(0).argsort(0),  # of every frame
    ],
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
    ],
    "09.1": [
        lambda S1, S2: S2[S1],  # the wrong way round
        lambda S1, S2: S2,
        lambda S1, S2: S1.argsort()[S2],  # where a rank goes, not who stands in a place
        lambda S1, S2: S1[S2].argsort(),
        lambda S1, S2: (S1 + S2) % len(S1),
    ],
    "10.1": [
        lambda segments, overlap: torch.cat(list(segments), 1),  # the overlaps are danced twice
        lambda segments, overlap: torch.cat([s[:, overlap:] for s in segments], 1),  # starts late
        lambda segments, overlap: torch.cat(  # keeps the later version of the overlap
            [*(s[:, : s.shape[1] - overlap] for s in segments[:-1]), segments[-1]], 1
        ),
        lambda segments, overlap: torch.cat(  # takes the stride for the overlap
            [segments[0], *(s[:, s.shape[1] - overlap :] for s in segments[1:])], 1
        ),
    ],
}
