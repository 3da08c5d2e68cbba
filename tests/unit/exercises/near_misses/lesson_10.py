"""Plausible wrong answers to the exercises of lesson 10: A long group dance."""

from itertools import pairwise

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


def long_dance(fault):
    """The loop over segments with one fault."""

    def answer(guess, root_x, noise, times, abar, overlap):
        stride = overlap if fault == "overlap for stride" else noise.shape[2] - overlap
        dance, last = noise[0, :, :0], noise[0]
        for i, z in enumerate(noise):
            known = dance[:, i * stride :][:, :overlap]
            order = row = torch.arange(len(z))
            if i and fault != "never sorts":
                order = root_x(known[:, -1 if fault == "sorts at the seam" else 0]).argsort()
                row = order if fault == "row for order" else order.argsort()
            if fault != "knows dancers as rows":
                known = known[order]
            x, k = z, known.shape[1]
            for step, (t, t_next) in enumerate(pairwise(times)):
                eps = last[:, -overlap:][:, :k] if fault == "noise of before" else z[:, :k]
                level = abar[t_next] if fault == "a level ahead" and t_next >= 0 else abar[t]
                pinned = level.sqrt() * known + (1 - level).sqrt() * eps
                if fault == "powers for strengths":
                    pinned = level * known + (1 - level) * eps
                if fault == "clean":
                    pinned = known
                if not (fault == "init" and step):
                    x = torch.cat([pinned, x[:, k:]], 1)
                x_0 = guess(x, t, i if fault == "segments for frames" else i * stride)
                if t_next >= 0:
                    free = (x - abar[t].sqrt() * x_0) / (1 - abar[t]).sqrt()
                    x = abar[t_next].sqrt() * x_0 + (1 - abar[t_next]).sqrt() * free
            if not i and fault != "first as it comes":
                row = root_x(x_0[:, 0]).argsort()
            if fault == "stays in ranks" and i:
                row = torch.arange(len(z))
            dance = dance[:, : i * stride] if fault == "keeps the later one" else dance
            dance = torch.cat([dance, x_0[row, dance.shape[1] - i * stride :]], 1)
            last = z
        return dance

    return answer


def along_dancers(segments, overlap):
    """Raises: the parts are shorter than the first one."""
    return torch.cat([segments[0], *(s[:, overlap:] for s in segments[1:])], 0)


def slices_a_list(segments, overlap):
    """Raises: only a tensor can be sliced so."""
    return torch.cat([segments[0], *segments[1:, :, overlap:]], 1)


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
        along_dancers,
        slices_a_list,
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
    "10.4": [
        long_dance("never sorts"),  # one order, that of the first frame, for all segments
        long_dance("sorts at the seam"),  # by the last frame they share, not the first
        long_dance("row for order"),  # puts rows back by the order itself, not its inverse
        long_dance("stays in ranks"),  # never puts them back: dancers are renumbered
        long_dance("knows dancers as rows"),  # sorts the result, not what is known
        long_dance("first as it comes"),  # does not number the dancers by rank
        long_dance("init"),  # the first input only
        long_dance("clean"),  # the released code
        long_dance("a level ahead"),  # noised to the step that comes next
        long_dance("powers for strengths"),  # no roots
        long_dance("noise of before"),  # the noise of the segment before
        long_dance("overlap for stride"),
        long_dance("segments for frames"),  # the music of the wrong place
        long_dance("keeps the later one"),  # what was shown changes
    ],
}
