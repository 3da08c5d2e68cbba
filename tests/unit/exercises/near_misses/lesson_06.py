"""Plausible wrong answers to the exercises of lesson 06: The sampling lab."""

from itertools import pairwise

import torch


def walk(*, sigma=None, left=None, mix=None, stop=None, first=0):
    """A sampler in which one part is another."""
    sigma = sigma or (lambda eta, a, b: eta * ((1 - b) / (1 - a) * (1 - a / b)).sqrt())
    left = left or (lambda b, sigma: (1 - b - sigma**2).clamp_min(0).sqrt())
    mix = mix or (lambda x, guess, a: (x - a.sqrt() * guess) / (1 - a).sqrt())

    def answer(denoise, x_T, times, abar, eta, noise):
        x = x_T
        for k, (t, t_next) in enumerate(pairwise(times[:stop] if stop else times)):
            guess = denoise(x, t)
            if t_next == -1:
                return guess
            a, b = abar[t], abar[t_next]
            s = torch.as_tensor(sigma(eta, a, b))
            z = noise[(k + first) % len(noise)]
            x = b.sqrt() * guess + left(b, s) * mix(x, guess, a) + s * z
        return guess

    return answer


NEAR_MISSES = {
    "06.1": [
        lambda net, x_t, w: net(x_t, music=True) + w * net(x_t, music=False),
        lambda net, x_t, w: w * net(x_t, music=True),
        lambda net, x_t, w: (1 + w) * net(x_t, music=True) - w * net(x_t, music=False),
        lambda net, x_t, w: (1 - w) * net(x_t, music=True) + w * net(x_t, music=False),
        lambda net, x_t, w: net(x_t, music=True) - w * net(x_t, music=False),
        lambda net, x_t, w: net(x_t, music=False) + w * net(x_t, music=True),
        lambda net, x_t, w: (
            net(x_t, music=True) + w * (net(x_t, music=True) - net(x_t, music=False))
        ),  # w = 0 is plain: another paper's w
    ],
    "06.2": [
        lambda x, mean, std, C: x.clamp(-1, 1),  # the released code
        lambda x, mean, std, C: mean + (x - mean).clamp(-4 * std, 4 * std),  # frames
        lambda x, mean, std, C: C.T @ (C @ x).clamp(-4 * std, 4 * std),  # around zero
        lambda x, mean, std, C: mean + C.T @ (C @ (x - mean)).clamp(-std, std),
        lambda x, mean, std, C: C.T @ (C @ (x - mean)).clamp(-4 * std, 4 * std),
        lambda x, mean, std, C: mean + C @ (C.T @ (x - mean)).clamp(-4 * std, 4 * std),
        lambda x, mean, std, C: mean + C.T @ (C @ (x - mean)).clamp(max=4 * std),  # one side
        lambda x, mean, std, C: mean + C.T @ (C @ (x - mean)).clamp(-4 * std[:1], 4 * std[:1]),
        lambda x, mean, std, C: C.T @ (C @ x - C @ mean.expand_as(x)),  # nothing is cut
    ],
    "06.3": [
        lambda path, y: torch.cat([path[:-1], path.new_tensor([y])]),  # pasted
        lambda path, y: path + (y - path[-1]),  # the start moves, too
        lambda path, y: torch.linspace(path[0].item(), y, len(path)),  # forgets the dance
        lambda path, y: path + torch.linspace(0, 1, len(path)) ** 3 * (y - path[-1]),  # haste
        lambda path, y: path + torch.linspace(0, 1, len(path)) * y,  # misses the place
        lambda path, y: path + torch.arange(len(path)) / len(path) * (y - path[-1]),  # a share less
        lambda path, y: path * (y / path[-1]),
        lambda path, y: path - torch.linspace(0, 1, len(path)) * (y - path[-1]),
    ],
    "06.4": [
        walk(sigma=lambda eta, a, b: eta * (1 - b) / (1 - a) * (1 - a / b)),  # no root
        walk(sigma=lambda eta, a, b: eta),
        walk(sigma=lambda eta, a, b: eta * ((1 - a) / (1 - b) * (1 - a / b)).sqrt()),  # exchanged
        walk(sigma=lambda eta, a, b: 0),  # eta is forgotten
        walk(left=lambda b, sigma: (1 - b).sqrt()),  # fresh noise comes on top
        walk(left=lambda b, sigma: (1 - b).sqrt() - sigma),  # strengths, not powers, add up
        walk(stop=-2),  # a step early
        walk(first=1),  # the noise of the next step
        walk(mix=lambda x, guess, a: x - guess),  # not the noise that explains x
        walk(mix=lambda x, guess, a: (x - a * guess) / (1 - a)),  # no roots
        lambda denoise, x_T, times, abar, eta, noise: denoise(x_T, times[0]),  # one step
    ],
}
