"""Solutions of lesson 04."""

# %% 04.1
# The forward process is a weighted sum of dance and noise. Who knows the noise takes its share away
# and scales what is left. For large t the divisor is tiny: small errors in eps become huge.


def x0_from(x_t, eps, t, abar):
    return (x_t - (1 - abar[t]).sqrt() * eps) / abar[t].sqrt()


# %% 04.2
# x_s holds the share abar[s] of the signal's power and shall hold abar[t], so its power is scaled
# by their ratio. The noise in x_s is scaled along with it; new noise fills up to power 1. Both add
# up to one Gaussian noise, which is why one jump from x_0 does the same.
def further(x_s, s, t, abar, eps):
    left = abar[t] / abar[s]
    return left.sqrt() * x_s + (1 - left).sqrt() * eps


# %% 04.3
# The noise has the same strength at every frequency; a dance has not. The body travels far when it
# is slow, and what is fast is small. So noise eats a dance from the fine to the coarse, and on the
# way back a network first decides where everybody goes and last how a hand trembles.
drowned = {"sway": 620, "kick": 280, "tremble": 50}


# %% 04.4
# An error of 0.1 everywhere has the loss 0.1² = 0.01. It arrives in the dance multiplied by the
# root of (1 - abar) / abar, which is 12.8 at step 950. The loss of the noise has no idea of it.
def fool(eps, abar):
    return 950, eps + 0.1


# %% 04.5
# A straight line spends as many steps on each tenth of the power, so eight tenths of them are in
# the middle. The cosine spends more at both ends: fewer steps in the middle, but gentle ones where
# the last details are cleared. What is best is a matter of trying.
import torch


def my_abar(num_steps):
    return torch.linspace(0.99, 0.0005, num_steps)


# %% 04.6
# One axis for the dances: whatever differs from dance to dance (noise level, weight, music or none)
# has b numbers and is stretched over the others. Only the weights of the network are moved, against
# the gradient of the loss. Its length is cut at 1, so a batch that is hard to guess moves them no
# farther than others.
import torch


def training_step(net, W, batch, abar, weight, rate):
    x_0, t = batch["x_0"], batch["t"]
    a = abar[t].reshape(-1, 1, 1, 1)
    x_t = (a.sqrt() * x_0 + (1 - a).sqrt() * batch["eps"]).float()
    M = batch["M"] * batch["keep"][:, None, None]
    W = W.clone().requires_grad_()
    guess = net(W, x_t, t, M)
    error = (guess - x_0).square().mean(dim=(1, 2, 3))
    loss = (weight[t] * error).mean()
    (slope,) = torch.autograd.grad(loss, W)
    slope = slope / slope.norm().clamp(min=1)
    return loss.item(), (W - rate * slope).detach()
