"""Plausible wrong answers to the exercises of lessons 11 and 12."""

import torch

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
}
