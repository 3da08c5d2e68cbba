r"""State space duality: Mamba's scan as matrix products, several times as fast on a CPU.

Read first: notebook 08 · Dao & Gu 2024 (SSD, "Mamba-2") section 6 · `dancediff.nn.ssm`.

Symbols (axes: b batch · f frames · s ssm state · h heads · p channels of one head
         z chunks · i frames of one chunk)
    u       what goes in                             (b, f, (h p))
    delta   $\Delta$, how long a frame lasts, > 0    (b, f, h)
    A       decay rates, < 0                         (h,)
    B, C    how a frame is written, and read         (b, f, s)
    D_skip  D, the direct path                       (h,)
"""

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.ssm import MambaBlock, init_delta, selective_scan_ref

LANES = 64  # a multiple of what PyTorch's loops take at a time (AVX-512: 2 x 16 numbers)


def segsum(a: Tensor) -> Tensor:
    r"""Sum of a over every stretch: out[i, j] = $a_{j+1} + \dots + a_i$, $-\infty$ for j > i.

    Source: SSD listing 1.

    Shapes: a (..., f) -> (..., f, f).

    >>> segsum(torch.tensor([1.0, 2.0, 3.0]))
    tensor([[0., -inf, -inf],
            [2., 0., -inf],
            [5., 3., 0.]])
    """
    total = a.cumsum(-1)
    future = torch.ones(a.shape[-1], a.shape[-1], dtype=torch.bool, device=a.device).triu(1)
    return (total[..., :, None] - total[..., None, :]).masked_fill(future, -torch.inf)


def ssd_scan_ref(
    u: Tensor, delta: Tensor, A: Tensor, B: Tensor, C: Tensor, D_skip: Tensor
) -> Tensor:
    r"""The same scan frame by frame: all channels of a head share its decay. Read this one.

    $$h_f = e^{\Delta_f A}\, h_{f-1} + \Delta_f B_f u_f, \qquad y_f = C_f^\top h_f + D\,u_f$$

    Source: SSD section 2, with a scalar A for each head.

    Shapes: as `ssd_scan`.

    >>> one, half = torch.ones(1, 3, 1), torch.tensor([2.0]).log().neg()
    >>> ssd_scan_ref(one, one, half, one, one, torch.zeros(1)).flatten()
    tensor([1.0000, 1.5000, 1.7500])
    """
    p = u.shape[-1] // len(A)
    A = A.repeat_interleave(p)[:, None].expand(-1, B.shape[-1])
    delta, D_skip = delta.repeat_interleave(p, -1), D_skip.repeat_interleave(p)
    return selective_scan_ref(u, delta, A, B, C, D_skip)


def ssd_scan(
    u: Tensor,
    delta: Tensor,
    A: Tensor,
    B: Tensor,
    C: Tensor,
    D_skip: Tensor,
    *,
    chunk: int = 50,
) -> Tensor:
    r"""The scan with one decay per head, as matrix products (state space duality).

    With a scalar $a_f = \Delta_f A$ per head the recurrence unrolls into masked attention,

    $$y_i = \sum_{j \le i} (C_i^\top B_j)\, e^{a_{j+1} + \dots + a_i}\, \Delta_j u_j + D\,u_i,$$

    which is computed directly inside chunks of frames; between chunks only the state is passed on.

    Source: SSD section 6.  Differs: B and C are shared by all heads (the paper's n_groups = 1).

    Shapes: u (b, f, (h p)), delta (b, f, h), A, D_skip (h,), B, C (b, f, s) -> (b, f, (h p)).

    >>> u, B = torch.randn(2, 9, 4), torch.randn(2, 9, 3)          # two channels a head
    >>> inputs = u, torch.rand(2, 9, 2), -torch.rand(2), B, B, torch.ones(2)
    >>> torch.allclose(ssd_scan(*inputs, chunk=4), ssd_scan_ref(*inputs), atol=1e-5)
    True
    """
    f = u.shape[1]
    num_chunks = -(-f // chunk)
    length = -(-f // num_chunks)  # equal chunks, so that little or nothing is padded
    padding = num_chunks * length - f

    def cut(x: Tensor, heads: int = 1) -> Tensor:
        x = F.pad(x, (0, 0, 0, padding)) if padding else x
        return rearrange(x, "b (z i) (h p) -> b z h i p", z=num_chunks, h=heads)

    x, B_, C_ = cut(u, heads=len(A)), cut(B), cut(C)  # (b, z, h, i, p), (b, z, 1, i, s)
    delta_, a = cut(delta, heads=len(A)), cut(delta * A, heads=len(A))[..., 0]
    since_start = a.cumsum(-1)  # (b, z, h, i): log decay of what came into the chunk

    # What scales frames is put on the (i, j) weights: they are smaller than the frames are.
    weights = (C_ @ B_.mT) * segsum(a).exp() * delta_.mT
    weights = weights + torch.diag_embed(D_skip[:, None].expand(-1, length))
    y = weights @ x
    if num_chunks > 1:
        to_end = (since_start[..., -1:] - since_start).exp()[..., None]
        written = (B_ * (to_end * delta_)).mT @ x  # (b, z, h, s, p): what each chunk leaves behind
        kept = since_start[..., -1].exp()[..., None, None]
        states = [torch.zeros_like(written[:, 0])]
        for z in range(num_chunks - 1):
            states.append(kept[:, z] * states[-1] + written[:, z])
        y = y + (C_ * since_start.exp()[..., None]) @ torch.stack(states, dim=1)
    return rearrange(y, "b z h i p -> b (z i) (h p)")[:, :f]


class SSDBlock(MambaBlock):
    r"""`MambaBlock` with one decay rate and one $\Delta$ a head instead of one a channel.

    Source: Mamba-2.

    Shapes: x (b, f, d_model) -> (b, f, d_model).
    Raises: ValueError when ``head_dim`` does not divide the inner width.

    >>> SSDBlock(16)(torch.randn(2, 9, 16)).shape
    torch.Size([2, 9, 16])
    """

    def __init__(self, d_model: int, *, head_dim: int = 64, **sizes):
        """``head_dim``: channels of a head; ``sizes``: of `MambaBlock`."""
        super().__init__(d_model, **sizes)
        d_inner = self.out_proj.in_features
        head_dim = min(head_dim, d_inner)
        if d_inner % head_dim:
            raise ValueError(f"head_dim={head_dim} must divide the inner width {d_inner}")
        heads = d_inner // head_dim
        del self.dt_proj
        self.dt_bias = nn.Parameter(torch.empty(heads))
        init_delta(self.dt_bias)
        self.x_proj = nn.Linear(d_inner, heads + 2 * self.d_state, bias=False)
        self.A_log = nn.Parameter(torch.linspace(1, self.d_state, heads).log())
        self.D_skip = nn.Parameter(torch.ones(heads))

    def scan(self, u: Tensor, dt: Tensor, B: Tensor, C: Tensor) -> Tensor:
        """The recurrence, in float32."""
        delta = batch_invariant_softplus(dt + self.dt_bias)
        return ssd_scan(u, delta, -self.A_log.exp(), B, C, self.D_skip)


def batch_invariant_softplus(x: Tensor) -> Tensor:
    r"""Softplus of each number by itself.

    $$y = \ln(1 + e^x)$$

    A library takes many numbers at a time, and those that are left over at the end by another
    routine, which may round otherwise: the last frames of a batch would differ from the same
    frames in its middle. Here nothing is left over.

    Shapes: any -> the same.

    >>> x = torch.randn(3, 150, 4)
    >>> torch.equal(batch_invariant_softplus(x)[:1], batch_invariant_softplus(x[:1]))
    True
    >>> torch.allclose(batch_invariant_softplus(x), F.softplus(x))
    True
    """
    flat = x.flatten()
    return F.softplus(F.pad(flat, (0, -len(flat) % LANES)))[: len(flat)].view(x.shape)
