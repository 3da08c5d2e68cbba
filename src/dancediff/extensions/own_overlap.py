r"""Own overlap: training windows that begin with what the network itself makes of a dance.

Read first: notebook 10 · `dancediff.papers.tcdiffpp.long_group_sampling` · docs/drift.md.

In long sampling the first half of every segment was made by the network; in training it is a true
dance. What the network makes is a little off, and a network that never met that takes it for what
is wanted: the next segment is a little farther off, and so on.

Symbols (axes: b batch · n dancers · f frames · d motion features)
    x_0     clean motion, normalised                            (b, n, f, d)
    y       the network's own guess of it, from noise of step s (b, n, f, d)
    w       1 in the overlap, falling to 0 at its end           (f,)
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions, Denoiser
from dancediff.diffusion.schedule import noise_like, q_sample, send
from dancediff.lookup import table

FADE = 15  # frames at the end of the overlap over which the guess passes into the true dance
NOISE = (200, 700)  # thousandths of all steps: y keeps the dance, and the pose is the network's own


def overlap_weights(f: int) -> Tensor:
    r"""w: one in the first half of a window, but for its last frames, where it falls as a cosine.

    Shapes: -> (f,).

    >>> overlap_weights(150)[[0, 59, 75, 149]].tolist()
    [1.0, 1.0, 0.0, 0.0]
    """
    half = f // 2
    until_end = (half - torch.arange(f)).clamp(0, min(FADE, half)) / min(FADE, half)
    return 0.5 - 0.5 * torch.cos(math.pi * until_end)


@dataclass(frozen=True)
class OverlapDraw:
    """Which windows begin as the network makes them, and the noise that it makes them from."""

    rows: Tensor  # (k,) numbers of windows
    s: Tensor  # (k,) noise levels
    eps: Tensor  # (k, n, f, d)


def draw_overlap(
    x_0: Tensor, share: float, num_steps: int, generator: torch.Generator
) -> OverlapDraw | None:
    """Draw a share of the windows x_0 (b, n, f, d), rounded, and noise of levels in `NOISE`.

    None when that is no window.

    >>> draw_overlap(torch.zeros(8, 2, 30, 151), 0.25, 1000, torch.Generator()).rows.shape
    torch.Size([2])
    """
    k = round(share * len(x_0))
    if not k:
        return None
    rows = torch.randperm(len(x_0), generator=generator)[:k]
    low, high = (level * num_steps // 1000 for level in NOISE)
    s = torch.randint(low, max(high, low + 1), (k,), generator=generator)
    eps = noise_like(x_0[:k], generator)
    return OverlapDraw(send(rows, x_0.device), send(s, x_0.device), eps)


@torch.no_grad()
def with_own_overlap(
    model: Denoiser, x_0: Tensor, conditions: Conditions, drawn: OverlapDraw
) -> Tensor:
    r"""Replace the first half of some windows by the network's guess of it.

    $$x'_f = (1 - w_f)\,x_{0,f} + w_f\,y_f, \qquad
      y = \text{denoise}(\sqrt{\bar\alpha_s}\,x_0 + \sqrt{1 - \bar\alpha_s}\,\epsilon,\; s)$$

    The network is then given noisy $x'$ and still asked for the true $x_0$.

    Source: ours; after scheduled sampling (Bengio et al. 2015).
    Shapes: x_0 (b, n, f, d) -> the same; windows that are not drawn stay as they are.

    >>> from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
    >>> model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32))
    >>> conditions = Conditions(torch.randn(2, 20, 35), swap=torch.arange(3).expand(2, 3))
    >>> x_0, g = torch.randn(2, 3, 20, 151), torch.Generator().manual_seed(0)
    >>> changed = with_own_overlap(model, x_0, conditions, draw_overlap(x_0, 1.0, 1000, g)) != x_0
    >>> changed.any(-1).any(0).any(0).nonzero().flatten().tolist()
    [0, 1, 2, 3, 4, 5, 6, 7, 8, 9]
    """
    rows = x_0[drawn.rows]
    noisy = q_sample(rows, drawn.s, model.abar, drawn.eps).to(rows.dtype)
    y = model.denoise(noisy, drawn.s, conditions.rows(drawn.rows)).to(rows.dtype)
    w = table(overlap_weights, rows.shape[-2], like=rows)[:, None]
    return x_0.index_copy(0, drawn.rows, torch.where(w > 0, (1 - w) * rows + w * y, rows))
