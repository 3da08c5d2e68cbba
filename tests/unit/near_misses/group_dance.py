"""Plausible wrong answers to the exercises of lessons 05 to 10."""

from itertools import pairwise

import torch

from dancediff.exercises.group_dance import EXERCISES


def as_places(x, S, gap):
    """The places of the guess, given out in the order S; the gap is forgotten."""
    y = x.clone()
    y[S] = x.sort().values
    return y


def evenly(x, S, gap):
    """Right, but moves those who stand well, too."""
    y = x.clone()
    y[S] = x.mean() + gap * (torch.arange(len(x)) - (len(x) - 1) / 2)
    return y


def pushed_right(x, S, gap):
    """In order, but the whole group drifts."""
    y = x.clone()
    for left, right in pairwise(S):
        y[right] = max(x[right], y[left] + gap)
    return y


def nearest_place(start, places):
    return torch.cdist(start, places).argmin(1)  # two may want the same


def by_rank(start, places):
    """Left to left, right to right."""
    goes = torch.empty(len(start), dtype=torch.long)
    goes[start[:, 0].argsort()] = places[:, 0].argsort()
    return goes


def one_by_one(start, places):
    """The first takes what is nearest to her, the last what is left."""
    way, goes = torch.cdist(start, places), []
    for dancer in way:
        dancer[goes] = torch.inf
        goes.append(int(dancer.argmin()))
    return torch.tensor(goes)


def best(start, places):
    return EXERCISES["10.3"].spec(start, places)


def with_zeros(steps):
    return torch.cat([torch.zeros_like(steps[:, :1]), steps], dim=1)


def one_way(first, speed):
    """Everybody goes to the right, from where she stands."""
    steps = torch.arange(30)[:, None] * torch.tensor([speed / 30, 0.0, 0.0])
    return first[:, -1:] + steps


NEAR_MISSES = {
    "05.1": [
        lambda p_hat, p: (p_hat - p).square().mean(),  # places, not offsets
        lambda p_hat, p: (p_hat - p).diff(dim=0).square().mean(),  # neighbours only
        lambda p_hat, p: (p_hat - p).diff(dim=1).square().mean(),  # time, as the released code
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().mean(),  # with herself
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().sum(),
    ],
    "05.2": [
        {"simple": True, "vel": True, "fk": True, "contact": True, "dist": True},
        {"simple": True, "vel": False, "fk": True, "contact": False, "dist": True},
        {"simple": True, "vel": False, "fk": True, "contact": True, "dist": False},
        {"simple": True, "vel": False, "fk": True},
    ],
    "05.3": [
        lambda p: p,
        lambda p: p + 10,  # all aside: the distances are right
        lambda p: 10 * p,  # steps are ten times as long
        lambda p: p[:, torch.randperm(p.shape[1], generator=torch.Generator().manual_seed(0))],
        lambda p: torch.cat([p[:1] + 10, p[1:]]),  # the others stand well
        lambda p: p + 0.1 * torch.arange(len(p))[:, None, None],  # too little
        lambda p: p[0],
    ],
    "06.1": [
        lambda net, x_t, w: net(x_t, music=True) + w * net(x_t, music=False),
        lambda net, x_t, w: w * net(x_t, music=True),
        lambda net, x_t, w: (1 + w) * net(x_t, music=True) - w * net(x_t, music=False),
        lambda net, x_t, w: (1 - w) * net(x_t, music=True) + w * net(x_t, music=False),
    ],
    "06.2": [
        lambda x, mean, spread, C: x.clamp(-1, 1),  # the released code
        lambda x, mean, spread, C: mean + (x - mean).clamp(-4 * spread, 4 * spread),  # frames
        lambda x, mean, spread, C: C.T @ (C @ x).clamp(-4 * spread, 4 * spread),  # around zero
        lambda x, mean, spread, C: mean + C.T @ (C @ (x - mean)).clamp(-spread, spread),
        lambda x, mean, spread, C: C.T @ (C @ (x - mean)).clamp(-4 * spread, 4 * spread),
        lambda x, mean, spread, C: mean + C @ (C.T @ (x - mean)).clamp(-4 * spread, 4 * spread),
    ],
    "06.3": [
        lambda path, y: torch.cat([path[:-1], path.new_tensor([y])]),  # pasted
        lambda path, y: path + (y - path[-1]),  # the start moves, too
        lambda path, y: torch.linspace(path[0].item(), y, len(path)),  # forgets the dance
        lambda path, y: path + torch.linspace(0, 1, len(path)) ** 3 * (y - path[-1]),  # haste
        lambda path, y: path + torch.linspace(0, 1, len(path)) * y,  # misses the place
    ],
    "07.1": [
        lambda root: root[:, 0, 0].argsort(),  # who stands k-th, not which k
        lambda root: root[:, -1, 0].argsort().argsort(),  # at the last frame
        lambda root: root[:, 0, 2].argsort().argsort(),  # in depth
        lambda root: root[:, 0, 0].argsort(descending=True).argsort(),
        lambda root: root[:, 0, 0].argsort().argsort() + 1,
        lambda root: root[:, :, 0].argsort(0).argsort(0),  # of every frame
    ],
    "07.2": [
        lambda h: h,  # nobody hears anybody
        lambda h: h + h.roll(1, dims=1),  # hears her neighbour in the list only
        lambda h: h + h.cumsum(1),  # the first hears herself only
        lambda h: h + h.mean(2, keepdim=True),  # over the frames
        lambda h: h + torch.arange(h.shape[1])[:, None, None] * h.mean(1, keepdim=True),  # names
        lambda h: h.mean(1),
    ],
    "07.3": [
        {"nothing": True, "FP": True, "DPE": True, "DPE, FP": True, "all": True},
        {"nothing": False, "FP": False, "DPE": True, "DPE, FP": True, "all": True},
        {"nothing": False, "FP": False, "DPE": False, "DPE, FP": True, "all": True},
        {"nothing": False},
    ],
    "07.4": [
        lambda tokens, table: tokens + table.repeat_interleave(len(tokens) // len(table), 0),
        lambda tokens, table: tokens + table[0],
        lambda tokens, table: tokens + table.flip(0).repeat(len(tokens) // len(table), 1),
        lambda tokens, table: table.repeat(len(tokens) // len(table), 1),  # the tokens are lost
        lambda tokens, table: torch.cat([tokens[: len(table)] + table, tokens[len(table) :]]),
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
    ],
    "09.1": [
        lambda S1, S2: S2[S1],  # the wrong way round
        lambda S1, S2: S2,
        lambda S1, S2: S1.argsort()[S2],  # where a rank goes, not who stands in a place
        lambda S1, S2: S1[S2].argsort(),
        lambda S1, S2: (S1 + S2) % len(S1),
    ],
    "09.2": [
        as_places,
        evenly,
        pushed_right,
        lambda x, S, gap: x,
        lambda x, S, gap: x[S],
        lambda x, S, gap: evenly(x, S.argsort(), gap),  # the wrong way round
    ],
    "09.3": [
        lambda root: with_zeros(root[..., [0, 2]].diff(dim=1)),  # per frame, as the released code
        lambda root: with_zeros(30 * root[..., :2].diff(dim=1)),  # height for depth
        lambda root: with_zeros(30 * root.diff(dim=1)),  # in space
        lambda root: 30 * root[..., [0, 2]].diff(dim=1),  # a frame is missing
        lambda root: with_zeros(30 * root[..., [0, 2]].diff(dim=1)).roll(-1, dims=1),  # behind
        lambda root: with_zeros(30 * root[..., [0, 2]].diff(dim=1)).norm(dim=-1),  # no direction
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
    "10.2": [
        lambda first: first[:, -30:],  # jumps back a second
        lambda first: first.flip(1)[:, :20],  # too short
        lambda first: first[:, -1:] + (first[:, -1:] - first[:, -2:-1]) * torch.arange(30)[:, None],
        lambda first: first[:, -1:].expand(-1, 30, -1) + 0.5,  # elsewhere
        lambda first: one_way(first, 6.0),  # runs
        lambda first: first[:1, -1:] + 0 * first[:, -30:],  # all on one place
    ],
    "10.3": [
        nearest_place,
        by_rank,
        one_by_one,
        lambda start, places: torch.arange(len(start)),
        lambda start, places: best(start, places).argsort(),  # who takes a place, not which place
        lambda start, places: torch.cdist(start, places).min(),
    ],
}
