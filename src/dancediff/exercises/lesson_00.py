"""Exercises of lesson 00, Tour: music in, dance out."""

from dancediff.exercises.exercise import Exercise

EXERCISES = {
    "00.1": Exercise(
        "a seed names a dance",
        {"same seed again": True, "another seed": False, "another song": False},
        "a seed fixes the noise a dance starts from; noise, song and settings fix the rest",
    ),
    "00.2": Exercise(
        "all at once",
        {"twice the steps": 2, "twice the dancers": 1, "twice the seconds": 1},
        "a guess is a guess of the whole dance: all dancers, all frames; only the steps say how "
        "often the network guesses",
    ),
}
