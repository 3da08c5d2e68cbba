"""Exercises of lesson 03: A data set you can trust."""

import torch

from dancediff.motion.representation import Normalizer

GRAVITY = 9.81  # m/s²


def _true_fps(height):
    return float((GRAVITY / -height.diff(n=2).mean()) ** 0.5)


def _jump_cases() -> list[tuple]:
    cases = []
    for fps, frames, speed in ((60, 20, 2.0), (120, 41, 2.4), (30, 9, 0.7)):
        time = torch.arange(frames, dtype=torch.float64) / fps
        cases.append((1 + speed * time - GRAVITY / 2 * time**2,))
    return cases


def _leaks(train, test):
    return sum(any(a == b and abs(s - k) < 150 for b, k in train) for a, s in test)


def _leaks_cases() -> list[tuple]:
    grid = [(take, start) for take in "abc" for start in range(0, 451, 75)]
    by_take = ([w for w in grid if w[0] != "b"], [w for w in grid if w[0] == "b"])
    apart = ([("a", 0), ("b", 150)], [("a", 150), ("b", 0), ("c", 0)])  # they touch, no more
    return [
        (grid[::2], grid[1::2]),
        by_take,
        apart,
        ([("a", 100), ("a", 130)], [("a", 0)]),
        ([("a", 0)], [("a", 100), ("b", 149)]),
    ]


def _split(takes):
    groups: list = []
    for name, song, parts in takes:
        ties = {name, ("song", song), *parts}
        groups = [g for g in groups if not g & ties] + [
            ties.union(*(g for g in groups if g & ties))
        ]
    test: set = set()
    for group in sorted(groups, key=len):
        if len(test) < len(takes) / 10:
            test |= {name for name, *_ in takes if name in group}
    return test


def _take_cases() -> list[tuple]:
    plain = [(f"take{k}", f"song{k % 7}", ()) for k in range(20)]
    # duets, and groups put together from them: no song can be held out without its ties
    songs = ("tango", "salsa", "salsa", "waltz", "swing", "swing", "polka", "samba", "disco")
    duets = [(f"d{k}", song, ()) for k, song in enumerate(songs)]
    groups = [("g01", "tango", ("d0", "d1")), ("g23", "salsa", ("d2", "d3"))]
    groups += [("g46", "swing", ("d4", "d6")), ("g78", "samba", ("d7", "d8"))]
    return [(plain,), (duets + groups,), ((duets + groups)[::-1],)]


def _splits(got, takes) -> str:
    test = set(got)
    if strange := test - {name for name, *_ in takes}:
        return f"there is no take {sorted(map(str, strange))[0]!r}"
    if not 0.1 <= len(test) / len(takes) <= 0.4:
        return f"{len(test)} of {len(takes)} takes are test takes, expected a tenth to four tenths"
    for side in (test, {name for name, *_ in takes} - test):
        if torn := [n for n, _, parts in takes if n in side and not set(parts) <= side]:
            return f"{torn[0]!r} and a take it was made from are on two sides"
    songs = [{song for name, song, _ in takes if (name in test) == side} for side in (True, False)]
    return f"both sides dance to {min(songs[0] & songs[1])!r}" if songs[0] & songs[1] else ""


def _rescale(train, new):
    return Normalizer.fit(train).normalize(new)


def _clip_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    train = torch.rand(3, 6, 4, generator=draw) * torch.tensor([5.0, 1, 2, 1])
    train[..., 3] = torch.tensor([0.0, 1, 0])[:, None]  # a contact that is constant in each clip
    new = torch.rand(2, 6, 4, generator=draw) * torch.tensor([8.0, 2, 1, 1])  # goes further
    new[..., 3] = torch.tensor([1.0, 0])[:, None]
    return [(train, new), (train, train[2:])]


SPECS = {
    "03.1": {"spec": _true_fps, "cases": _jump_cases},
    "03.2": {"spec": _leaks, "cases": _leaks_cases},
    "03.3": {"spec": _split, "cases": _take_cases, "accepts": _splits},
    "03.4": {"spec": _rescale, "cases": _clip_cases},
}
