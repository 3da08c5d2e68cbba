r"""Kalman smoothing of paths: dancers who go on as fast as before, seen with noise.

Read first: Dai et al. 2025 (TCDiff) section 3.2 · Rauch, Tung and Striebel 1965.

Symbols (axes: f frames)
    p   a coordinate as it was guessed        (..., f)
    s   place and velocity                    (..., 2)
    P   their covariance                      (2, 2)
"""

import torch
from torch import Tensor

PROCESS, MEASUREMENT = 0.01, 0.1  # noise, as in the released code


def smoothed(p: Tensor) -> Tensor:
    r"""The likeliest path of a point whose velocity drifts, given where it was seen.

    $$s_{f+1} = \begin{pmatrix} 1 & 1 \\ 0 & 1 \end{pmatrix} s_f + q, \qquad p_f = (1\ 0)\,s_f + r$$

    Source: TCDiff's code: constant velocity, variances 0.01 and 0.1.  Differs: it only filters,
    which lags behind; the backward pass after it looks ahead as well.

    Shapes: (..., f) -> (..., f).

    >>> line = torch.linspace(0, 3, 40)
    >>> torch.allclose(smoothed(line), line, atol=1e-4)
    True
    """
    F = torch.tensor([[1.0, 1.0], [0.0, 1.0]], dtype=torch.float64)
    Q = PROCESS * torch.eye(2, dtype=torch.float64)
    seen = p.double().cpu()
    velocity = seen[..., 1] - seen[..., 0] if p.shape[-1] > 1 else torch.zeros_like(seen[..., 0])
    s, P = torch.stack([seen[..., 0], velocity], dim=-1), torch.eye(2, dtype=torch.float64)
    filtered, expected = [(s, P)], []
    for f in range(1, p.shape[-1]):
        s, P = s @ F.T, F @ P @ F.T + Q
        expected.append((s, P))
        gain = P[:, 0] / (P[0, 0] + MEASUREMENT)
        s = s + gain * (seen[..., f] - s[..., 0])[..., None]
        P = P - gain[:, None] * P[0]
        filtered.append((s, P))
    states = [filtered[-1][0]]
    for (s, P), (ahead, P_ahead) in zip(filtered[-2::-1], expected[::-1], strict=True):
        back = P @ F.T @ torch.linalg.inv(P_ahead)
        states.append(s + (states[-1] - ahead) @ back.T)
    return torch.stack(states[::-1], dim=-2)[..., 0].to(p)
