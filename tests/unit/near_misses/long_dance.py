"""Plausible wrong answers to the exercises of lessons 11 and 12."""

import torch


def wave(frames, phase, *, turns=0.5, away=0.2):
    when = torch.arange(frames)[:, None] / 30
    joints = torch.zeros(frames, 24, 3)
    joints[..., 0] = away * torch.sin(2 * torch.pi * (turns * when + phase))
    return joints


def circles(frames):
    joints = wave(frames, torch.zeros(24))
    joints[..., 2] = wave(frames, torch.full((24,), 0.25))[..., 0]
    return joints


def frames_from(N, n, first=-4, stop=None):
    return torch.arange(0, N + 1, n)[:stop, None] + torch.arange(first, first + 8)


def forget_in_place(root):
    root[..., (0, 2)] -= root[:, :1, (0, 2)].clone()
    return root


def added_up(paths, *, meet=False, fade=False):
    """Steps added up; at a seam none, the mean of both sides, or (all along a walk) a slow fade."""
    step = paths.diff(dim=1, prepend=paths[:, :1])
    if meet:
        step[1:, 0] = (step[:-1, -1] + step[1:, 1]) / 2
    if fade:
        step = torch.nn.functional.avg_pool1d(step.flatten()[None], 31, 1, 15)[0]
    return paths[0, 0] + step.flatten().cumsum(0)


def shifted(paths):
    """Each walk begins where the one before ended; a frame of standing still at every seam."""
    ends = (paths[:-1, -1] - paths[1:, 0]).cumsum(0)
    return (paths + torch.cat([torch.zeros(1), ends])[:, None]).flatten()


NEAR_MISSES = {
    "11.1": [
        lambda v: ((v[:-2] < v[1:-1]) & (v[1:-1] >= v[2:])).nonzero()[:, 0] + 1,  # hills
        lambda v: ((v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])).nonzero()[:, 0],  # a frame early
        lambda v: ((v[:-2] > v[1:-1]) & (v[1:-1] < v[2:])).nonzero()[:, 0] + 1,  # no flat valley
        lambda v: ((v[:-2] >= v[1:-1]) & (v[1:-1] <= v[2:])).nonzero()[:, 0] + 1,  # all of it
        lambda v: (v[1:-1] < v.mean()).nonzero()[:, 0] + 1,  # slow, not slowest
        lambda v: (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:]),  # which, not where
    ],
    "11.2": [
        lambda root: root - root[:, :1],  # heights, too
        lambda root: root - root.mean(1, keepdim=True) * torch.tensor([1.0, 0, 1]),
        lambda root: root - root[:1, :1] * torch.tensor([1.0, 0, 1]),  # all to the first one
        lambda root: root * torch.tensor([0.0, 1, 0]),  # and it goes nowhere
        lambda root: root - root[:, :1] * torch.tensor([1.0, 1, 0]),  # z is not up
        forget_in_place,  # right, and the dance it was cut from is spoilt
    ],
    "11.3": [
        lambda frames: wave(frames, torch.zeros(24)),  # all together: a valley a second
        circles,  # nobody ever rests
        lambda frames: torch.zeros(frames, 24, 3),  # nobody moves
        lambda frames: wave(frames, 0.25 * (torch.arange(24) % 2)),  # two halves: still valleys
        lambda frames: wave(frames, torch.arange(24) / 48, turns=0.2),  # too slow a wave
        lambda frames: wave(frames, torch.arange(24) / 48, away=1e-4),  # nobody would see it
        lambda frames: wave(frames, torch.arange(24) / 48)[..., 0],  # x only
    ],
    "11.4": [
        lambda N, n: (
            (n * torch.arange(N // n + 1) // (N // n)).clamp(4, N - 4)[:, None]
            + torch.arange(-4, 4)
        ),  # the released code: a share of a local
        frames_from,  # begins before the clip and ends behind it
        lambda N, n: frames_from(N, n, first=0).clamp(max=N - 1),  # begin at the border
        lambda N, n: frames_from(N, n, stop=-1).clamp(min=0),  # one too few
        lambda N, n: torch.arange(0, N + 1, n).clamp(4, N - 4),  # middles only
    ],
    "11.5": [
        {
            "how many soft ones": True,  # as many as there are rests
            "frames of the soft ones": True,
            "frames of the hard ones": False,
            "poses in the hard ones": True,
        },
        {
            "how many soft ones": False,
            "frames of the soft ones": True,
            "frames of the hard ones": True,  # hard ones are no rests
            "poses in the hard ones": True,
        },
        {
            "how many soft ones": False,
            "frames of the soft ones": True,
            "frames of the hard ones": False,
            "poses in the hard ones": False,  # "hard" as in "always the same"
        },
        {"how many soft ones": False},
    ],
    "12.1": [
        lambda R, swap: R[:, swap],  # partners, seen from the same side
        lambda R, swap: torch.diag(torch.tensor([-1.0, 1, 1])) @ R[:, swap],  # no rotation
        lambda R, swap: (
            torch.diag(torch.tensor([-1.0, 1, 1])) @ R @ torch.diag(torch.tensor([-1.0, 1, 1]))
        ),  # nobody changes sides
        lambda R, swap: R[:, swap] * torch.tensor([-1.0, 1, 1]),
        lambda R, swap: R[:, swap].mT,
    ],
    "12.2": [
        lambda times, s: sum(t > 50 * (1 - s) for t in times[:-2]),  # the released code
        lambda times, s: sum(t + 1 > (times[0] + 1) * s for t in times[:-2]),  # 1 - s
        lambda times, s: round(s * (len(times) - 1)),  # a share of the steps, not of the way
        lambda times, s: sum(t + 1 > (times[0] + 1) * (1 - s) for t in times[:-1]),  # the last, too
        lambda times, s: sum(t + 1 > 1000 * (1 - s) for t in times[1:-1]),  # where they end
    ],
    "12.3": [
        lambda real, made: -0.5 * (real - made).mean(),  # never content
        lambda real, made: 0.5 * ((1 + real).relu() + (1 - made).relu()).mean(),  # the other way
        lambda real, made: ((1 - real).relu() + (1 + made).relu()).mean(),  # twice as much
        lambda real, made: 0.5 * ((1 - real).relu() + (1 + made).relu()),  # one for each dance
        lambda real, made: 0.5 * ((-real).relu() + made.relu()).mean(),  # without the margin
    ],
    "12.4": [
        {
            "a hard cue": True,
            "the frame beside a hard cue": False,
            "a soft cue, s = 0.5": False,
            "a soft cue, s = 1": True,  # "at every step", but the last
        },
        {
            "a hard cue": True,
            "the frame beside a hard cue": True,  # pasting does not spread
            "a soft cue, s = 0.5": False,
            "a soft cue, s = 1": False,
        },
        {
            "a hard cue": False,  # the last step is followed by the hard cues, too
            "the frame beside a hard cue": False,
            "a soft cue, s = 0.5": False,
            "a soft cue, s = 1": False,
        },
        {"hard": True, "soft": False},
    ],
    "12.5": [
        lambda paths: paths.flatten(),  # glued
        shifted,  # no jump, but one step of nothing, and a kink
        added_up,  # the same
        lambda paths: added_up(paths, meet=True),  # half a kink, twice
        lambda paths: added_up(paths, fade=True),  # smooth, and every step is another
        lambda paths: added_up(paths, meet=True) - paths[0, 0],  # begins at 0
    ],
}
