"""Plausible wrong answers to the exercises of lesson 13."""

from dataclasses import replace

NEAR_MISSES = {
    "13.1": [
        lambda dance: dance,
        lambda dance: dance.joints(),
        lambda dance: dance.frames(0, 1),
        lambda dance: replace(dance, root=2 * dance.root),
        lambda dance: replace(dance, root=dance.root.mean(1, keepdim=True).expand_as(dance.root)),
    ],
}
