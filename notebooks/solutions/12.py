"""Solutions of lesson 12."""

# %% 12.1
# The partner's rotation, R[:, swap], is seen from the other side: D from the left mirrors what comes
# out of it, D from the right what goes into it. Two mirrors make a rotation again (determinant 1).


def mirror(R, swap):
    D = R.new_tensor([-1.0, 1.0, 1.0]).diag()
    return D @ R[:, swap] @ D


# %% 12.2
# T is known from the first step. Both sides count steps of the schedule, not of the sampler, so a
# sampler with 20 steps holds the cues for the same part of the way as one with 1000.
def held(times, s):
    T = times[0] + 1
    return sum(t + 1 > T * (1 - s) for t in times[:-2])


# %% 12.3
# A margin of 1 on each side, and nothing to learn beyond it: relu. The critic is then content, and
# its gradient is left for the dances that it is not sure about.


def critic(real, made):
    missing = (1 - real).relu().mean() + (1 + made).relu().mean()
    return missing / 2
