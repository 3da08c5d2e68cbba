"""Exercises of lesson 12: Fill in the rest.

Read first: notebook 12 · `dancediff.exercises.exercise`.
"""

import torch

from dancediff.diffusion.samplers import sampling_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.exercises.shared import NUMBERS, unlike
from dancediff.motion.rotation import rot6d_to_matrix
from dancediff.papers.lodge.cue_guidance import guided_steps
from dancediff.papers.lodge.losses import l_critic, l_genre, l_recon


def _mirror(R, swap):
    Q = torch.diag(R.new_tensor([-1.0, 1.0, 1.0]))
    return Q @ R[:, swap] @ Q


def _poses() -> list[tuple]:
    R = rot6d_to_matrix(torch.randn(4, 5, 6, generator=torch.Generator().manual_seed(0)))
    return [(R, torch.tensor([0, 2, 1, 3, 4])), (R[:, :3], torch.tensor([2, 1, 0]))]


def _ways() -> list[tuple]:
    ways = [[999, 749, 499, 249, -1], [499, 374, 249, 124, -1]]  # T is 1000, and 500
    ways += [list(range(999, -2, -1))]  # t > for t + 1 > is one step off
    ways += [list(sampling_times(s, n, cosine_abar())) for s, n in (("ddim", 50), ("dpm", 20))]
    return [(way, s) for way in ways for s in (0.0, 0.3, 0.5, 1.0)]


def _walks() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    wander = torch.randn(3, 64, generator=draw).cumsum(1).cumsum(1) / 6000
    turn_back = torch.tensor([[0.03], [-0.02]]) * torch.arange(40.0) + torch.tensor([[1.0], [4.0]])
    return [(wander,), (turn_back,)]


def _path(paths):
    n = paths.shape[1]
    step = paths.diff(dim=1, prepend=paths[:, :1]).flatten()
    for seam in range(n, len(step), n):
        ends = step[seam - 8].item(), step[seam + 8].item()
        step[seam - 7 : seam + 8] = torch.linspace(*ends, 17)[1:-1]
    return paths[0, 0] + step.cumsum(0)


def _joins(got, paths) -> str:
    L, n = paths.shape
    if wrong := unlike(got, (L * n,), NUMBERS):
        return wrong
    path = torch.as_tensor(got).double()
    if abs(path[0] - paths[0, 0]) > 1e-3:
        return f"your path begins at {path[0]:.2f} m, expected {paths[0, 0]:.2f}"
    step, own = path.diff(), paths.double().diff(dim=1)
    for k in range(L):  # step[i - 1] leads to frame i
        first, last = 8 if k else 1, n - 8 if k < L - 1 else n - 1
        change = step[k * n + first - 1 : k * n + last] - own[k, first - 1 : last]
        if change.abs().max() > 1e-4:
            return f"walk {k} has other steps than its own, far from every seam"
    kink = step.diff().abs().max()
    if kink > 0.01:
        return f"somewhere a move differs by {100 * kink:.1f} cm from the one before"
    return ""


def _verdicts() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    sure = torch.tensor([1.5, 3.0]), torch.tensor([-1.0, -2.0])
    return [(2 * torch.randn(6, generator=draw), 2 * torch.randn(6, generator=draw)), sure]


def _one_round(local, D, W, V, batch, weight, rate):
    x_0, M, g = batch["x_0"], batch["M"], batch["g"][:, None]
    W, V = (weights.clone().requires_grad_() for weights in (W, V))
    made = local(W, batch["x_t"], M)
    real, fake = (D(V, x, M).gather(1, g) for x in (x_0, made.detach()))
    V = (V - rate * torch.autograd.grad(l_critic(real, fake), V)[0]).detach()
    loss = l_recon(made, x_0) + weight * l_genre(D(V, made, M).gather(1, g))
    return (W - rate * torch.autograd.grad(loss, W)[0]).detach(), V


def _local(W, x_t, M):
    """A guess that is a weighted sum of noisy dance and music, bent."""
    return torch.tanh(torch.cat([x_t, M], dim=-1) @ W)


def _critic(V, x, M):
    """A verdict for each genre; as many are sure as are not."""
    return (2 * torch.sin(torch.cat([x, M], dim=-1) @ V)).mean(1)


def _rounds() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    cases = []
    for (b, f, d, m, G), weight in (((4, 3, 5, 2, 3), 0.5), ((6, 2, 3, 4, 4), 2.0)):
        batch = {
            "x_0": torch.randn(b, f, d, generator=draw),
            "x_t": torch.randn(b, f, d, generator=draw),
            "M": torch.randn(b, f, m, generator=draw),
            "g": torch.randint(G, (b,), generator=draw),
        }
        W, V = (0.8 * torch.randn(d + m, k, generator=draw) for k in (d, G))
        cases.append((_local, _critic, W, V, batch, weight, 0.4))
    return cases


def _is_a_round(got, local, D, W, V, batch, weight, rate) -> str:
    right = _one_round(local, D, W, V, batch, weight, rate)
    pairs = zip(("V of the critic", "W of the local model"), got[::-1], right[::-1], strict=True)
    for (name, yours, there), old in zip(pairs, (V, W), strict=True):
        moved = torch.as_tensor(yours).detach()
        if moved.shape != there.shape:
            return f"shape {tuple(moved.shape)} of {name}, expected {tuple(there.shape)}"
        if not (moved - there).norm() <= 1e-3 * (there - old).norm():
            far, right_far = (moved - old).norm(), (there - old).norm()
            return f"{name} moves by {far:.4g}, expected {right_far:.4g}, down its own gradient"
    return ""


SPECS = {
    "12.1": {"spec": _mirror, "cases": _poses},
    "12.2": {"spec": guided_steps, "cases": _ways},
    "12.4": {"spec": _path, "cases": _walks, "accepts": _joins},
    "12.5": {"spec": l_critic, "cases": _verdicts},
    "12.6": {"spec": _one_round, "cases": _rounds, "accepts": _is_a_round},
}
