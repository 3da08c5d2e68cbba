"""Solutions of lesson 00."""

# %% 00.1
# The only chance in the machine is the noise that the dance starts from and is stirred with, and
# the seed fixes all of it. Another song is another condition M, so the noise is cleared away
# towards another dance.
same_dance = {"same seed again": True, "another seed": False, "another song": False}

# %% 00.2
# The noise that is cleared is the whole dance: all dancers and all frames at once, so one guess
# says everything about all of them. Only the steps say how often the network guesses. More than
# five seconds are danced in segments (lesson 10), and each segment is cleared by itself.
more_guesses = {"twice the steps": 2, "twice the dancers": 1, "twice the seconds": 1}
