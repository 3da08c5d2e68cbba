"""Solutions of lesson 06."""


# %% 06.1
# What the music changes is the difference of two guesses. Going along it w times the way is an
# exaggeration for w above 1; w = 1 is the guess with music, w = 0 the one without.
def guide(denoiser, x_t, w):
    without = denoiser(x_t, music=False)
    return without + w * (denoiser(x_t, music=True) - without)


# %% 06.2
# At +-1 a tremble passes as long as it stays inside, and a place far out is cut though it is
# right. Frequency by frequency the slow parts, which are large, may be large, and fast ones not.
def clip_waves(x, mean, std, C):
    waves = C @ (x - mean)
    return mean + C.T @ waves.clamp(-4 * std, 4 * std)


# %% 06.3
# Every frame takes its share of what is missing in the end, so the dancer starts early and keeps
# its own movement on top. A ramp is the simplest; the covariance of the lesson knows how dances do.
import torch


def reach_end(path, y):
    return path + torch.linspace(0, 1, len(path)) * (y - path[-1])
