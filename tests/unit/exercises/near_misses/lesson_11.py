"""Plausible wrong answers to the exercises of lesson 11: Think in phrases."""

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


def plan(*, near=12, apart=8, best=max, empty=4, anywhere=False, first=-4, order=None, end=None):
    """The planner with one number or rule changed; with none it is right."""

    def answer(rests, energy, N, n):
        middles = [4]
        for border in range(0, N, n):
            free, last = border + near, border + n - (near if end is None else end)
            for half in (border, border + n // 2):
                here = range(N) if anywhere else rests
                fit = [b for b in here if max(free, half) <= b < half + n // 2 and b <= last]
                b = best(fit, key=lambda b: energy[b]) if fit else half + n // empty
                middles.append(b)
                free = max(b + apart, free)
            middles.append(min(border + n, N - 4))
        middles = order(middles) if order else middles
        return torch.tensor(middles)[:, None] + torch.arange(first, first + 8)

    return answer


def two_fullest(rests, energy, N, n):
    """Of a whole local, wherever they are in it."""
    middles = [4]
    for border in range(0, N, n):
        fit = [b for b in rests if border + 12 <= b <= border + n - 12]
        middles += sorted(sorted(fit, key=lambda b: -energy[b])[:2])
        middles.append(min(border + n, N - 4))
    return torch.tensor(middles)[:, None] + torch.arange(-4, 4)


NEAR_MISSES = {
    "11.1": [
        lambda v: ((v[:-2] < v[1:-1]) & (v[1:-1] >= v[2:])).nonzero()[:, 0] + 1,  # hills
        lambda v: ((v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])).nonzero()[:, 0],  # a frame early
        lambda v: ((v[:-2] > v[1:-1]) & (v[1:-1] < v[2:])).nonzero()[:, 0] + 1,  # no flat valley
        lambda v: ((v[:-2] >= v[1:-1]) & (v[1:-1] <= v[2:])).nonzero()[:, 0] + 1,  # all of it
        lambda v: (v[1:-1] < v.mean()).nonzero()[:, 0] + 1,  # slow, not slowest
        lambda v: (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:]),  # which, not where
        lambda v: ((v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])).nonzero()[:, 0] + 2,  # a frame late
        lambda v: v.argmin()[None],  # the deepest only
        lambda v: (v[1:] > v[:-1]).nonzero()[:, 0],  # wherever it rises
    ],
    "11.2": [
        lambda frames: wave(frames, torch.zeros(24)),  # all together: a valley a second
        circles,  # nobody ever rests
        lambda frames: torch.zeros(frames, 24, 3),  # nobody moves
        lambda frames: wave(frames, 0.25 * (torch.arange(24) % 2)),  # two halves: still valleys
        lambda frames: wave(frames, torch.arange(24) / 48, turns=0.2),  # too slow a wave
        lambda frames: wave(frames, torch.arange(24) / 48, away=1e-4),  # nobody would see it
        lambda frames: wave(frames, torch.arange(24) / 48)[..., 0],  # x only
    ],
    "11.3": [
        lambda N, n: (
            (n * torch.arange(N // n + 1) // (N // n)).clamp(4, N - 4)[:, None]
            + torch.arange(-4, 4)
        ),  # the released code: a share of a local
        frames_from,  # begins before the clip and ends behind it
        lambda N, n: frames_from(N, n, first=0).clamp(max=N - 1),  # begin at the border
        lambda N, n: frames_from(N, n, stop=-1).clamp(min=0),  # one too few
        lambda N, n: torch.arange(0, N + 1, n).clamp(4, N - 4),  # middles only
        lambda N, n: frames_from(N, n).clamp(0, N - 1),  # frames twice at both ends
        lambda N, n: frames_from(N, n)[1:-1],  # inner borders only
        lambda N, n: torch.arange(0, N + 1, n).clamp(4, N - 4)[:, None] + torch.arange(-3, 5),
    ],
    "11.4": [
        lambda root: root - root[:, :1],  # heights, too
        lambda root: root - root.mean(1, keepdim=True) * torch.tensor([1.0, 0, 1]),
        lambda root: root - root[:1, :1] * torch.tensor([1.0, 0, 1]),  # all to the first one
        lambda root: root * torch.tensor([0.0, 1, 0]),  # and it goes nowhere
        lambda root: root - root[:, :1] * torch.tensor([1.0, 1, 0]),  # z is not up
        forget_in_place,  # right, and the dance it was cut from is spoilt
        lambda root: root - root[:, -1:] * torch.tensor([1.0, 0, 1]),  # ends at 0
        lambda root: root.diff(dim=1, prepend=root[:, :1]),  # steps
        lambda root: root - root[:, :1] * torch.tensor([1.0, 0, 0]),  # x only
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
    "11.6": [
        plan(best=lambda fit, key: fit[0]),  # the first rest, however little moves around it
        plan(best=min),  # the calmest
        plan(near=8),  # over the hard ones at the clip's ends
        plan(near=0),
        plan(apart=0),  # soft ones may overlap each other
        plan(end=0),  # looks at one of the borders only
        plan(near=13),  # more than 12, not 12 at least
        plan(apart=9),
        plan(empty=2),  # the middle of the local
        plan(anywhere=True),  # the most energy, at rest or not
        plan(first=-3),  # three frames before the middle and four behind it
        plan(order=lambda middles: middles[::3] + [b for k, b in enumerate(middles) if k % 3]),
        lambda rests, energy, N, n: plan()(rests, energy, N, n)[:, 4],  # middles only
        lambda rests, energy, N, n: plan()(rests, energy, N, n)[1:-1],  # the ends are no borders
        two_fullest,
    ],
}
