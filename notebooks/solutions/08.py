"""Solutions of lesson 08."""

# %% 08.1
# A pulse is written once, as delta * B, decays once per frame and is read by C. If A, B and C never
# change, every pulse leaves this same trace, so the scan is a convolution with it.
import torch


def kernel(A, B, C, delta, length):
    k = torch.arange(length)[:, None]
    return (C * torch.exp(k * delta * A) * delta * B).sum(-1)
