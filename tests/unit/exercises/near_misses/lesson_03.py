"""Plausible wrong answers to the exercises of lesson 03: A data set you can trust."""

import torch


def one_song_out(takes):
    return {name for name, song, _ in takes if song == takes[0][1]}


def only_parts_stay(takes):
    test = set()
    for name, _, parts in takes[::-1]:
        if len(test) < len(takes) / 10:
            test |= {name, *parts}
    return test


def only_makings_stay(takes):
    """Takes and what they were made of stay together, wherever that was put; songs do not."""
    groups: list = []
    for name, _, parts in takes:
        ties = {name, *parts}
        groups = [g for g in groups if not g & ties] + [
            ties.union(*(g for g in groups if g & ties))
        ]
    test: set = set()
    for group in sorted(groups, key=len):
        if len(test) < len(takes) / 10:
            test |= group
    return test


def per_clip(train, new):
    low, high = new.amin(1, keepdim=True), new.amax(1, keepdim=True)
    return 2 * (new - low) / (high - low).clamp_min(1e-6) - 1


def scale_of(*clips):
    return torch.cat(clips).amin((0, 1)), torch.cat(clips).amax((0, 1))


def scaled(new, low, high):
    return 2 * (new - low) / (high - low) - 1


def named(v):
    axis = int(v.abs().argmax())
    return ("-" if v[axis] < 0 else "") + "xyz"[axis]


def stretched(joints):
    return joints[:, 12] - joints[:, 7:9].mean(1)  # from the ankles to the neck


NEAR_MISSES = {
    "03.1": [
        lambda height: 9.81 / -height.diff(n=2).mean(),  # no root
        lambda height: (9.81 / height.diff().abs().mean()) ** 0.5,  # a speed, not its change
        lambda height: (9.81 / 2 / -height.diff(n=2).mean()) ** 0.5,  # half of g is for places
        lambda height: (-height.diff(n=2).mean() / 9.81) ** 0.5,  # seconds a frame
        lambda height: 60.0,  # believes the header
        lambda height: (9.81 * len(height) / -height.diff(n=2).sum()) ** 0.5,  # sum over fewer
        lambda height: (9.81 / -height.diff(n=3).mean()) ** 0.5,  # one difference too many
        lambda height: 120.0,
    ],
    "03.2": [
        lambda train, test: sum(w in train for w in test),  # only the very same window
        lambda train, test: sum(take in {a for a, _ in train} for take, _ in test),  # any of a take
        lambda train, test: sum(a == b and abs(s - t) < 150 for a, s in test for b, t in train),
        lambda train, test: sum(
            any(a == b and abs(s - t) <= 150 for b, t in train) for a, s in test
        ),
        lambda train, test: sum(any(abs(s - t) < 150 for _, t in train) for _, s in test),
        lambda train, test: sum(  # later windows only
            any(a == b and 0 <= s - t < 150 for b, t in train) for a, s in test
        ),
        lambda train, test: sum(  # earlier windows only
            any(a == b and 0 <= t - s < 150 for b, t in train) for a, s in test
        ),
        lambda train, test: sum(
            any(a == b and abs(s - t) < 150 for a, s in test) for b, t in train
        ),
        lambda train, test: sum(any(a == b and abs(s - t) < 75 for b, t in train) for a, s in test),
        lambda train, test: any(a == b and abs(s - t) < 150 for b, t in train for a, s in test),
    ],
    "03.3": [
        lambda takes: {name for name, *_ in takes[::5]},  # takes as they come
        one_song_out,  # parts are torn
        only_parts_stay,  # songs are torn
        only_makings_stay,  # the same, and nothing else is wrong
        lambda takes: {name for name, _, parts in takes if parts},  # all that is composed
        lambda takes: {name for name, *_ in takes},
        lambda takes: [],
        lambda takes: {song for _, song, _ in takes[:3]},
    ],
    "03.4": [
        per_clip,  # what TCDiff does
        lambda train, new: scaled(new, *scale_of(train[-1:])),  # the last clip's scale
        lambda train, new: scaled(new, *scale_of(train, new)),  # has seen the test
        lambda train, new: scaled(new, *scale_of(train)).clamp(-1, 1),  # hides what is new
        lambda train, new: scaled(new, train.amin(), train.amax()),  # one scale for all channels
        lambda train, new: (new - train.mean((0, 1))) / train.std((0, 1)),
        lambda train, new: (new - train.amin((0, 1))) / (train.amax((0, 1)) - train.amin((0, 1))),
        lambda train, new: scaled(new, train[0].amin(0), train[0].amax(0)),  # the first clip's
        lambda train, new: scaled(train, *scale_of(train))[: len(new)],  # the wrong dances
    ],
    "03.5": [
        lambda joints: named(stretched(joints)[0]),  # a frame that may lie
        lambda joints: named(joints.mean((0, 1))),  # where the body is
        lambda joints: named(joints.amax((0, 1)) - joints.amin((0, 1))),  # the longest way
        lambda joints: "xyz"[int(stretched(joints).mean(0).abs().argmax())],  # no sign
        lambda joints: named(stretched(joints).abs().mean(0)),  # on the hands is up, too
        lambda joints: named(-stretched(joints).mean(0)),
        lambda joints: "xyz"[int(joints[:, 0].std(0).argmin())],  # the pelvis moves least along it
        lambda joints: named((joints[:, 18] - joints[:, 19]).mean(0)),  # from hand to hand
        lambda joints: int(stretched(joints).mean(0).abs().argmax()),  # a number, not a name
    ],
}
