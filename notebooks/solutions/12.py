"""Solutions of lesson 12."""

# %% 12.1
# The partner's rotation, R[:, swap], is seen from the other side: Q from the left mirrors what comes
# out of it, Q from the right what goes into it. Two mirrors make a rotation again (determinant 1).


def mirror(R, swap):
    Q = R.new_tensor([-1.0, 1.0, 1.0]).diag()
    return Q @ R[:, swap] @ Q


# %% 12.2
# T is known from the first step. Both sides count steps of the schedule, not of the sampler, so a
# sampler with 20 steps holds the cues for the same part of the way as one with 1000.
def held(times, s):
    T = times[0] + 1
    return sum(t + 1 > T * (1 - s) for t in times[:-2])


# %% 12.3
# A hard cue is pasted after every step, the last one too, so it is met whatever the network thinks;
# but only there, and the frame beside it jumps. A soft cue is a hint: the last word is the
# network's, and one that does not listen forgets it in a single step.
met = {
    "a hard cue": True,
    "the frame beside a hard cue": False,
    "a soft cue, s = 0.5": False,
    "a soft cue, s = 1": False,
}


# %% 12.4
# Places cannot be repaired without a jump, steps can: a straight ramp from the steps before the
# seam to those after it. The library moves both sides towards their mean instead. Both are right,
# and with both the place where a walk ends depends on all the walks before it.
import torch


def join(paths):
    n = paths.shape[1]
    step = paths.diff(dim=1, prepend=paths[:, :1]).flatten()
    for seam in range(n, len(step), n):
        ends = step[seam - 8].item(), step[seam + 8].item()
        step[seam - 7 : seam + 8] = torch.linspace(*ends, 17)[1:-1]
    return paths[0, 0] + step.cumsum(0)


# %% 12.5
# A margin of 1 on each side, and nothing to learn beyond it: relu. The critic is then content, and
# its gradient is left for the dances that it is not sure about.


def critic(real, made):
    missing = (1 - real).relu().mean() + (1 + made).relu().mean()
    return missing / 2


# %% 12.6
# Both play with the same guess, but each step follows one network only: the critic takes the guess
# as given, and the local model takes the critic as it now is. Along L_G it climbs the verdict; the
# squared error keeps it near the true dance, which a critic alone would not ask for.
import torch


def one_round(local, D, W, V, batch, weight, rate):
    x_0, M, g = batch["x_0"], batch["M"], batch["g"]
    rows = torch.arange(len(g))
    W, V = W.clone().requires_grad_(), V.clone().requires_grad_()
    made = local(W, batch["x_t"], M)
    real = D(V, x_0, M)[rows, g]
    fake = D(V, made.detach(), M)[rows, g]
    L_D = ((1 - real).relu().mean() + (1 + fake).relu().mean()) / 2
    V = (V - rate * torch.autograd.grad(L_D, V)[0]).detach()
    L_G = -D(V, made, M)[rows, g].mean()
    loss = (made - x_0).square().mean() + weight * L_G
    W = (W - rate * torch.autograd.grad(loss, W)[0]).detach()
    return W, V
