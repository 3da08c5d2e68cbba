"""Plausible wrong answers to the exercises of lesson 10: A long group dance."""

import torch

from dancediff.exercises import EXERCISES


def one_way(first, speed):
    """All dancers go to the right, from where they stand."""
    steps = torch.arange(30)[:, None] * torch.tensor([speed / 30, 0.0, 0.0])
    return first[:, -1:] + steps


def nearest_place(start, places):
    return torch.cdist(start, places).argmin(1)  # two may want the same


def by_rank(start, places):
    """Left to left, right to right."""
    goes = torch.empty(len(start), dtype=torch.long)
    goes[start[:, 0].argsort()] = places[:, 0].argsort()
    return goes


def one_by_one(start, places):
    """The first dancer takes the nearest place, the last one what is left."""
    way, goes = torch.cdist(start, places), []
    for dancer in way:
        dancer[goes] = torch.inf
        goes.append(int(dancer.argmin()))
    return torch.tensor(goes)


def best(start, places):
    return EXERCISES["10.3"].spec(start, places)


NEAR_MISSES = {
    "10.1": [
        lambda segments, overlap: torch.cat(list(segments), 1),  # the overlaps are danced twice
        lambda segments, overlap: torch.cat([s[:, overlap:] for s in segments], 1),  # starts late
        lambda segments, overlap: torch.cat(  # keeps the later version of the overlap
            [*(s[:, : s.shape[1] - overlap] for s in segments[:-1]), segments[-1]], 1
        ),
        lambda segments, overlap: torch.cat(  # takes the stride for the overlap
            [segments[0], *(s[:, s.shape[1] - overlap :] for s in segments[1:])], 1
        ),
        lambda segments, overlap: torch.cat(  # the first is cut, too, and the last is not
            [*(s[:, overlap:] for s in segments[:-1]), segments[-1]], 1
        ),
        lambda segments, overlap: torch.cat(  # one frame too many
            [segments[0], *(s[:, overlap - 1 :] for s in segments[1:])], 1
        ),
        lambda segments, overlap: torch.cat(  # dancers instead of frames
            [segments[0], *(s[:, overlap:] for s in segments[1:])], 0
        ),
        lambda segments, overlap: torch.cat(  # a tensor only, not a list
            [segments[0], *segments[1:, :, overlap:]], 1
        ),
    ],
    "10.2": [
        lambda first: first[:, -30:],  # jumps back a second
        lambda first: first.flip(1)[:, :20],  # too short
        lambda first: first[:, -1:] + (first[:, -1:] - first[:, -2:-1]) * torch.arange(30)[:, None],
        lambda first: first[:, -1:].expand(-1, 30, -1) + 0.5,  # elsewhere
        lambda first: EXERCISES["10.2"].spec(first) + 0.05,  # right, but for 5 cm at the seam
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
        lambda start, places: torch.cdist(start, places).argmin(0),  # places choose
        lambda start, places: best(places, start),  # who takes a place
        lambda start, places: best(start * torch.tensor([1.0, 0]), places),  # sideways only
    ],
}
