"""Plausible wrong answers to all exercises, which their checkers must refuse."""

from near_misses import foundations, group_dance, long_dance, measures

NEAR_MISSES = (
    foundations.NEAR_MISSES | group_dance.NEAR_MISSES | long_dance.NEAR_MISSES
) | measures.NEAR_MISSES
