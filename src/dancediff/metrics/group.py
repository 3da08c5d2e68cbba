r"""How real a group's motion is (GMR) and how much its dancers move alike (GMC).

Read first: docs/metrics_group.md.

Symbols (axes: n dancers · f frames · j joints)
    joints  positions, metres, y up                                        (n, f, j, 3)
    w       half width of the window that velocities are averaged over, frames
    E       horizontal, vertical energy and expenditure of a joint         (n, f - 1, j, 3)
    path    frames of two dancers that belong together, from dynamic time warping   (k, 2)
"""

from itertools import combinations

import numpy as np
import torch
from torch import Tensor

from dancediff.metrics.inputs import ACCELERATION, as_group, check_compat

GAIN = 1.5  # of the energies inside the logarithm
COMPAT = ("gcd",)


def frame_energies_ref(joints: Tensor, *, window: int, dt: float) -> Tensor:
    r"""The energies of every joint frame by frame, as the formula says. Read this one.

    $$v_i = \tfrac1{|K|}\sum_{k \in K} \frac{p_{i+k} - p_{i+k-1}}{dt},\quad
      a_i = \tfrac1{|K|}\sum_{k \in K} \frac{p_{i+k+1} - 2p_{i+k} + p_{i+k-1}}{dt^2}$$
    $$E_i = \big(v_x^2 + v_z^2,\; v_y^2,\; \lVert a_i \rVert\big)$$

    with K the offsets from -w to w that stay inside the clip.

    Source: Onuma et al. 2008, with the sums of AIOZ-GDance's code.

    Shapes: as `frame_energies`.

    >>> straight = torch.arange(4.0)[None, :, None, None] * torch.tensor([1.0, 2.0, 0.0])
    >>> frame_energies_ref(straight, window=1, dt=1.0)[0, :, 0].tolist()
    [[1.0, 4.0, 0.0], [1.0, 4.0, 0.0], [1.0, 4.0, 0.0]]
    """
    p, f, energies = joints, joints.shape[1], []
    for i in range(1, f):
        K = range(i - window, i + window + 1)
        v = [(p[:, k] - p[:, k - 1]) / dt for k in K if 0 < k < f]
        a = [(p[:, k + 1] - 2 * p[:, k] + p[:, k - 1]) / dt**2 for k in K if 0 < k < f - 1]
        x, y, z = torch.stack(v).mean(0).unbind(-1)
        energies.append(torch.stack([x**2 + z**2, y**2, torch.stack(a).mean(0).norm(dim=-1)], -1))
    return torch.stack(energies, dim=1)


def frame_energies(joints: Tensor, *, window: int, dt: float) -> Tensor:
    r"""Kinetic energy along and up, and energy expenditure, of every joint in frames 1..f-1.

    `frame_energies_ref`, faster: its sums telescope, so only their ends are read.

    $$\sum_{k=a}^{b} (p_k - p_{k-1}) = p_b - p_{a-1}$$

    Shapes: joints (n, f, j, 3) metres, f >= 3; dt seconds -> (n, f - 1, j, 3).

    >>> joints, options = torch.randn(2, 9, 4, 3).double(), {"window": 2, "dt": 1 / 30}
    >>> slow = frame_energies_ref(joints, **options)
    >>> torch.allclose(frame_energies(joints, **options), slow)
    True
    """
    f = joints.shape[1]
    i = torch.arange(1, f)
    first, last = (i - window).clamp_min(1), (i + window).clamp_max(f - 1)
    # in the dtype of joints, or dt would be rounded to float32
    length = (last - first + 1)[:, None, None].to(joints)
    v = (joints[:, last] - joints[:, first - 1]) / (length * dt)
    last = (i + window).clamp_max(f - 2)
    length = (last - first + 1)[:, None, None].to(joints)
    step = joints.diff(dim=1)  # step[i] leads from frame i to i + 1
    a = (step[:, last] - step[:, first - 1]) / (length * dt**2)
    flat = v[..., 0] ** 2 + v[..., 2] ** 2
    return torch.stack([flat, v[..., 1] ** 2, a.norm(dim=-1)], dim=-1)


def group_features(joints: Tensor, *, fps: float = 30.0, compat: str | None = None) -> Tensor:
    r"""One vector for a whole group: how much each joint moves, over frames and dancers.

    $$g_{j} = \log\big(1 + 1.5\,\tfrac1{n(f-1)}\textstyle\sum_{d,i} E_{d,i,j}\big)$$

    with the energies of `frame_energies`, w = 1, in the order horizontal, vertical, expenditure
    for each joint.

    Source: GMR of AIOZ-GDance, as its authors' code (GCD) computes it; TCDiff++ publishes none.
    Differs: ``compat="gcd"`` takes dt = 1/30 s whatever ``fps`` says, as that code does. The text
    that defines GMR speaks of velocities of the pose vector in pieces of a dance; neither is done.

    Shapes: joints (n, f, j, 3) metres -> (3 j,).
    Raises: ValueError for fewer than 2 dancers or 3 frames, NaN, or another ``compat``.

    >>> group_features(torch.zeros(2, 5, 24, 3)).shape
    torch.Size([72])
    """
    check_compat(compat, COMPAT, "GMR")
    joints = as_group(joints, fps, least=ACCELERATION, dancers=2)
    dt = 1 / 30 if compat == "gcd" else 1 / fps
    E = frame_energies(joints, window=1, dt=dt).mean(dim=(0, 1))
    return torch.log1p(GAIN * E).flatten()


def gmr(features: Tensor, reference: Tensor) -> float:
    r"""Group motion realism: Frechet distance of `group_features` to those of real groups.

    $$\text{GMR} = \lVert\mu - \mu_r\rVert^2 +
        \operatorname{Tr}\big(\Sigma + \Sigma_r - 2(\Sigma\Sigma_r)^{1/2}\big)$$

    after standardising by the reference. 0 is best.

    Source: AIOZ-GDance; same distance as `fid`, which see.

    Shapes: features (N, 3 j) one row for each group, reference (M, 3 j).
    Raises: ValueError as `fid`.
    """
    from dancediff.metrics.fidelity import fid

    return float(fid(features, reference))


def gmc(joints: Tensor, *, fps: float = 30.0, compat: str | None = None) -> float:
    r"""Group motion correlation: how strongly dancers move at moments when they look alike.

    $$\text{GMC} = \frac{2}{n(n-1)}\sum_{d<e}\frac1{|P_{de}|}\sum_{(i,k)\in P_{de}}
        \phi_d(i)\cdot\phi_e(k),\qquad \phi_d(i) = \log(1 + 1.5\,E_{d,i})$$

    P is the `dtw` path over the Euclidean distance of all joints, E comes from `frame_energies`
    with w = 2. Frame 0 has no energy, so its pairs are left out. The product is not normalised:
    livelier dancers score higher, a frozen group 0.

    Source: GMC of AIOZ-GDance, as its authors' code (GCD) computes it.
    Differs: ``compat="gcd"`` takes dt = 1/30 s whatever ``fps`` says, squares the distances, and
    pairs frame i with the energy of frame i + 1, all as that code does.

    Shapes: joints (n, f, j, 3) metres, in one world.
    Raises: ValueError for fewer than 2 dancers or 3 frames, NaN, or another ``compat``.

    >>> gmc(torch.zeros(3, 10, 24, 3))
    0.0
    """
    check_compat(compat, COMPAT, "GMC")
    joints = as_group(joints, fps, least=ACCELERATION, dancers=2)
    dt = 1 / 30 if compat == "gcd" else 1 / fps
    phi = torch.log1p(GAIN * frame_energies(joints, window=2, dt=dt)).flatten(2)
    flat = joints.flatten(2)
    scores = []
    for d, e in combinations(range(len(flat)), 2):
        cost = torch.cdist(flat[d], flat[e], compute_mode="donot_use_mm_for_euclid_dist")
        path = dtw(cost**2 if compat == "gcd" else cost)
        path = path[(path < len(phi[d])).all(1)] if compat == "gcd" else path[(path > 0).all(1)] - 1
        scores.append((phi[d, path[:, 0]] * phi[e, path[:, 1]]).sum(-1).mean())
    return float(torch.stack(scores).mean())


def dtw_ref(cost: Tensor) -> Tensor:
    r"""Dynamic time warping cell by cell. Read this one.

    $$D_{ik} = c_{ik} + \min(D_{i-1,k-1},\, D_{i-1,k},\, D_{i,k-1})$$

    Each step moves one on in i, in k, or in both; of equal ways the path takes both, then i.

    Shapes: cost (a, b), finite -> path (k, 2), from (0, 0) to (a - 1, b - 1).

    >>> dtw_ref(torch.tensor([[0.0, 1.0, 4.0], [1.0, 0.0, 0.0]])).tolist()
    [[0, 0], [1, 1], [1, 2]]
    """
    a, b = cost.shape
    D = np.full((a + 1, b + 1), np.inf)  # the border stands at -1, where no way leads through
    D[-1, -1] = 0  # but the first cell's way begins there
    for i in range(a):
        for k in range(b):
            D[i, k] = cost[i, k].item() + min(D[i - 1, k - 1], D[i - 1, k], D[i, k - 1])
    i, k = a - 1, b - 1
    path = [(i, k)]
    while (i, k) != (0, 0):
        i, k = min([(i - 1, k - 1), (i - 1, k), (i, k - 1)], key=lambda cell: D[cell])
        path.append((i, k))
    return torch.tensor(path[::-1])


def dtw(cost: Tensor) -> Tensor:
    r"""Dynamic time warping: the cheapest way through a table from its first to its last cell.

    `dtw_ref`, faster: cells of one anti-diagonal do not need each other, so a sweep takes them all
    at once.

    Shapes: cost (a, b) -> path (k, 2), from (0, 0) to (a - 1, b - 1).
    Raises: ValueError when the table is empty or holds anything not finite.

    >>> cost = torch.rand(9, 7)
    >>> torch.equal(dtw(cost), dtw_ref(cost))
    True
    """
    if cost.ndim != 2 or cost.numel() == 0 or not cost.isfinite().all():
        raise ValueError(f"cost has shape {tuple(cost.shape)}; expected a finite table (a, b)")
    D = _accumulate(cost.detach().double().numpy())
    i, j = cost.shape[0] - 1, cost.shape[1] - 1
    path = [(i, j)]
    while i or j:
        # row i of D lies at i + 1 and diagonal i + j at i + j + 1; the border is infinite
        both, up, left = D[i + j - 1, i], D[i + j, i], D[i + j, i + 1]
        if both <= min(up, left):
            i, j = i - 1, j - 1
        elif up <= left:
            i -= 1
        else:
            j -= 1
        path.append((i, j))
    return torch.tensor(path[::-1])


def _accumulate(cost: np.ndarray) -> np.ndarray:
    """D with a border of infinity: D[i + j + 1, i + 1] belongs to cell (i, j)."""
    a, b = cost.shape
    padded = np.full((a, a + b), np.inf)
    padded[:, :b] = cost
    # one column less in each row moves row i by i cells: skew[i, i + j] = cost[i, j]
    skew = padded.ravel()[: a * (a + b - 1)].reshape(a, a + b - 1).T.copy()
    D = np.full((a + b, a + 1), np.inf)
    D[1, 1] = cost[0, 0]
    for k in range(1, a + b - 1):
        best = np.minimum(D[k, :-1], D[k, 1:])
        np.minimum(best, D[k - 1, :-1], out=best)
        np.add(best, skew[k], out=D[k + 1, 1:])
    return D
