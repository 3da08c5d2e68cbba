"""Plausible wrong answers to the exercises of lesson 06: The sampling lab."""

import torch

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
}
