"""Exercises of lesson 03: A data set you can trust.

Read first: `dancediff.exercises.exercise`.
"""

import torch

from dancediff.motion.representation import Normalizer
from dancediff.motion.rotation import rotation_about
from dancediff.motion.skeleton import SMPL24, forward_kinematics

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


def _up(joints):
    feet = joints[:, [SMPL24.index("lankle"), SMPL24.index("rankle")]].mean(1)
    mean = (joints[:, SMPL24.index("neck")] - feet).mean(0)
    axis = int(mean.abs().argmax())
    return ("-" if mean[axis] < 0 else "") + "xyz"[axis]


_TURNS = {"y": ("x", 0.0), "z": ("x", 90.0), "-y": ("z", 180.0), "-z": ("x", -90.0)} | {
    "x": ("z", -90.0), "-x": ("z", 90.0),
}  # fmt: skip


def _posture_cases() -> list[tuple]:
    """Bodies that spin and walk ten metres, of which some frames lie or stand on the hands."""
    body = forward_kinematics(torch.eye(3).expand(24, 3, 3), torch.zeros(3))
    step = torch.arange(40.0)
    spin = rotation_about("y", step / 3)
    lying = rotation_about("x", torch.tensor(torch.pi / 2))
    upside_down = rotation_about("z", torch.tensor(torch.pi))
    cases = []
    for up, pose, frames, unit, floor in (
        ("z", lying, 9, 100.0, -3.0),
        ("-y", upside_down, 12, 1.0, 2.0),
        ("x", lying, 14, 39.37, 5.0),
        ("y", upside_down, 13, 1.0, 0.0),
        ("-z", lying, 0, 100.0, -4.0),
        ("-x", upside_down, 12, 1000.0, 1.0),
    ):
        R = torch.cat([spin[:frames] @ pose, spin[frames:]])
        path = torch.stack([step / 4, floor + 0 * step, 6 - step / 10], -1)
        axis, degrees = _TURNS[up]
        turn = rotation_about(axis, torch.deg2rad(torch.tensor(degrees)))
        cases.append((unit * (body @ R.mT + path[:, None]) @ turn.T,))
    return cases


def _tells_up(got, joints) -> str:
    right = _up(joints)
    return "" if got == right else f"yours {got!r}, expected {right!r}"


SPECS = {
    "03.1": {"spec": _true_fps, "cases": _jump_cases},
    "03.2": {"spec": _leaks, "cases": _leaks_cases},
    "03.3": {"spec": _split, "cases": _take_cases, "accepts": _splits},
    "03.4": {"spec": _rescale, "cases": _clip_cases},
    "03.5": {"spec": _up, "cases": _posture_cases, "accepts": _tells_up},
}
