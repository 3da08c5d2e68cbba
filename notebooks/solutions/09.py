"""Solutions of lesson 09."""

# %% 09.1
# S2 names the dancers by their rank in the middle, and S1 says who had which rank there. So S1,
# read at the places S2 asks for, goes from the end through the middle to the start.


def both(S1, S2):
    return S1[S2]
