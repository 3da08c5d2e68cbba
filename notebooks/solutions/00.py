"""Solutions of lesson 00."""

# %% 00.1
# The only chance in the machine is the noise that the dance starts from and is stirred with, and
# the seed fixes all of it. Another song is another condition M, so the noise is cleared away
# towards another dance.
same_dance = {"same seed again": True, "another seed": False, "another song": False}
