"""Plausible wrong answers to the exercises of lesson 15: Live."""

import math

import numpy as np


def steers(begin, wishes, *, late=0, first=True, all_at_once=False, only_last=False, stops=False):
    """Pieces of a stream that is steered, in one of several wrong ways."""
    stream, pieces = begin(), []
    if first:
        stream.set(**wishes.get(0, {"energy": 1.0}))
    if all_at_once:
        for knobs in wishes.values():
            stream.set(**knobs)
    if only_last:
        wishes = dict(list(wishes.items())[-1:])
    for piece in stream:
        pieces.append(piece)
        if len(pieces) - late in wishes:
            stream.set(**wishes[len(pieces) - late])
            if stops:
                break
    return pieces


def steered_too_early(begin, wishes):
    """A wish for k pieces is asked for when k - 1 are there."""
    return steers(begin, wishes, late=-1)


def foretold(past, now, until, *, recent=8, middle=np.median, since=None, from_zero=False):
    """Beats that go on evenly, from the wrong place or at the wrong pace."""
    T = middle(np.diff(past[-recent:]))
    begin = past[-1] if since is None else since
    beats = begin + T * np.arange(0 if from_zero else 1, 200)
    return beats[(beats > now) & (beats <= until)]


NEAR_MISSES = {
    "15.1": [
        lambda begin, wishes: steers(begin, wishes, late=1),  # a piece too late
        steered_too_early,
        lambda begin, wishes: steers(begin, wishes, first=False),  # nothing before the first
        lambda begin, wishes: steers(begin, wishes, all_at_once=True),
        lambda begin, wishes: steers(begin, wishes, only_last=True),
        lambda begin, wishes: steers(begin, wishes, stops=True),  # the rest is not danced
        lambda begin, wishes: list(begin()),  # nobody asks
        lambda begin, wishes: steers(begin, wishes)[1:],
    ],
    "15.2": [
        {
            "half as many steps halve the denoising": False,
            "half as many steps halve the hearing": False,
            "a song of twice the length is heard twice as long before the first step": False,
            "the second piece waits for the hearing again": False,
        },
        {
            "half as many steps halve the denoising": True,
            "half as many steps halve the hearing": True,
            "a song of twice the length is heard twice as long before the first step": False,
            "the second piece waits for the hearing again": False,
        },
        {
            "half as many steps halve the denoising": True,
            "half as many steps halve the hearing": False,
            "a song of twice the length is heard twice as long before the first step": True,
            "the second piece waits for the hearing again": False,
        },
        {
            "half as many steps halve the denoising": True,
            "half as many steps halve the hearing": False,
            "a song of twice the length is heard twice as long before the first step": False,
            "the second piece waits for the hearing again": True,
        },
        {
            "half as many steps halve the denoising": False,
            "half as many steps halve the hearing": True,
            "a song of twice the length is heard twice as long before the first step": True,
            "the second piece waits for the hearing again": True,
        },
    ],
    "15.3": [
        lambda frames, seconds: math.ceil(frames - 30 * seconds),  # a frame too much
        lambda frames, seconds: round(frames - 30 * seconds),
        lambda frames, seconds: math.floor(30 * seconds),  # the new frames
        lambda frames, seconds: frames // 2,  # as in the paper
        lambda frames, seconds: math.floor(frames - seconds),  # seconds taken for frames
        lambda frames, seconds: math.floor((frames - 30 * seconds) / 2),
        lambda frames, seconds: max(math.floor(frames - 30 * seconds) - 1, 0),
    ],
    "15.4": [
        lambda past, now, until: foretold(past, now, until, recent=1000),  # the verse counts, too
        lambda past, now, until: foretold(past, now, until, middle=np.mean),  # one is missing
        lambda past, now, until: foretold(past, now, until, middle=np.max),
        lambda past, now, until: foretold(past, now, until, since=now),  # from now, not from a beat
        lambda past, now, until: foretold(past, now - 9, until),  # those of the past
        lambda past, now, until: foretold(past, now, until + 2),  # beyond what was asked for
        lambda past, now, until: foretold(past, now, until)[:1],  # the next one only
        lambda past, now, until: foretold(past, now, until) + 0.25,
        lambda past, now, until: np.arange(now, until, 0.5),  # 120 a minute, whatever was heard
    ],
}
