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


def played(
    costs,
    frames,
    steps,
    lead,
    *,
    rests=True,
    stalls=True,
    waits_for_first=True,
    first_counts=False,
    at_once=False,
    fewest=4,
    again=False,
    ahead_of=0,
):
    """A player in one of several wrong ways."""
    rows, ready, end, most = [], 0.0, 0.0, steps
    for k, (cost, n) in enumerate(zip(costs, frames, strict=True)):
        begun = max(ready, end + ahead_of * n / 30 - lead) if rests and k else ready
        late = begun + steps * cost > end and (k or first_counts)
        if late and at_once:
            steps = max(steps // 2, fewest)
        ready = begun + steps * cost
        shown = max(ready, end) if stalls and (k or waits_for_first) else end
        rows.append((begun, ready, shown, steps))
        if again and not late:
            steps = most
        if late and not at_once:
            steps = max(steps // 2, fewest)
        end = shown + n / 30
    return np.array(rows)


def waits_in_the_last_column(costs, frames, steps, lead):
    """The seconds of waiting where the steps should be."""
    rows = played(costs, frames, steps, lead)
    due = np.append(0, rows[:-1, 2] + np.array(frames[:-1]) / 30)
    return np.column_stack([rows[:, :3], rows[:, 2] - due])


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
            "half as many steps about halve the denoising": False,
            "half as many steps halve the hearing": False,
            "a song of twice the length is heard twice as long before the first step": False,
            "the second piece waits for the hearing again": False,
        },
        {
            "half as many steps about halve the denoising": True,
            "half as many steps halve the hearing": True,
            "a song of twice the length is heard twice as long before the first step": False,
            "the second piece waits for the hearing again": False,
        },
        {
            "half as many steps about halve the denoising": True,
            "half as many steps halve the hearing": False,
            "a song of twice the length is heard twice as long before the first step": True,
            "the second piece waits for the hearing again": False,
        },
        {
            "half as many steps about halve the denoising": True,
            "half as many steps halve the hearing": False,
            "a song of twice the length is heard twice as long before the first step": False,
            "the second piece waits for the hearing again": True,
        },
        {
            "half as many steps about halve the denoising": False,
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
    "15.5": [
        lambda *case: played(*case, rests=False),  # as fast as it can
        lambda *case: played(*case, stalls=False),  # the player never waits
        lambda *case: played(*case, waits_for_first=False),  # played from the call on
        lambda *case: played(*case, first_counts=True),  # the first wait counts as late
        lambda *case: played(*case, at_once=True),  # the late piece itself has fewer steps
        lambda *case: played(*case, fewest=1),
        lambda *case: played(*case, fewest=99),  # the least is the most
        lambda *case: played(*case, again=True),  # all steps again after a piece in time
        lambda *case: played(*case, ahead_of=1),  # the piece to come counts as ready
        lambda costs, frames, steps, lead: played(costs, frames, steps, lead / 30),  # as frames
        lambda costs, frames, steps, lead: played(costs, frames, steps, 0),
        lambda costs, frames, steps, lead: played(costs, [30 * n for n in frames], steps, lead),
        lambda costs, frames, steps, lead: played([c / steps for c in costs], frames, steps, lead),
        lambda *case: played(*case).T,
        lambda *case: played(*case)[:, [1, 0, 2, 3]],
        waits_in_the_last_column,
    ],
}
