"""Plausible wrong answers to the exercises of lesson 00, Tour: music in, dance out."""

NEAR_MISSES = {
    "00.1": [
        {"same seed again": False, "another seed": False, "another song": False},
        {"same seed again": True, "another seed": False, "another song": True},
        {"same seed again": True},
        True,
    ],
    "00.2": [
        {"twice the steps": 1, "twice the dancers": 2, "twice the seconds": 2},
        {"twice the steps": 2, "twice the dancers": 1, "twice the seconds": 2},  # frame by frame
        {"twice the steps": 2, "twice the dancers": 2, "twice the seconds": 1},  # one at a time
        [2, 1, 1],
    ],
}
