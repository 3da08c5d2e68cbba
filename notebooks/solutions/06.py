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


# %% 06.4
# A step believes the guess and asks which noise would explain x; then it mixes both for the next
# step, with a share of the noise replaced by fresh one. Both shares together have the power
# 1 - abar, whatever eta is. The last step has no noise to mix: the guess is the dance.
from itertools import pairwise


def walk(denoise, x_T, times, abar, eta, noise):
    x = x_T
    for k, (t, t_next) in enumerate(pairwise(times)):
        guess = denoise(x, t)
        if t_next == -1:
            return guess
        eps = (x - abar[t].sqrt() * guess) / (1 - abar[t]).sqrt()
        a, a_next = abar[t], abar[t_next]
        sigma = eta * ((1 - a_next) / (1 - a) * (1 - a / a_next)).sqrt()
        x = a_next.sqrt() * guess + (1 - a_next - sigma**2).sqrt() * eps + sigma * noise[k]
