"""Plausible wrong answers to all exercises, which their checkers must refuse."""

from near_misses import (
    lesson_00,
    lesson_01,
    lesson_02,
    lesson_03,
    lesson_04,
    lesson_05,
    lesson_06,
    lesson_07,
    lesson_08,
    lesson_09,
    lesson_10,
    lesson_11,
    lesson_12,
    lesson_13,
    lesson_14,
    lesson_15,
    lesson_16,
)

NEAR_MISSES = (
    lesson_00.NEAR_MISSES
    | lesson_01.NEAR_MISSES
    | lesson_02.NEAR_MISSES
    | lesson_03.NEAR_MISSES
    | lesson_04.NEAR_MISSES
    | lesson_05.NEAR_MISSES
    | lesson_06.NEAR_MISSES
    | lesson_07.NEAR_MISSES
    | lesson_08.NEAR_MISSES
    | lesson_09.NEAR_MISSES
    | lesson_10.NEAR_MISSES
    | lesson_11.NEAR_MISSES
    | lesson_12.NEAR_MISSES
    | lesson_13.NEAR_MISSES
    | lesson_14.NEAR_MISSES
    | lesson_15.NEAR_MISSES
    | lesson_16.NEAR_MISSES
)
