r"""State space models: a memory that is updated once per frame.

Read first: notebook 08 · TCDiff++ section 3.4 · Gu & Dao 2023 (Mamba) algorithm 2 · Dao & Gu 2024
(SSD, "Mamba-2") section 6.

Symbols (axes: b batch · f frames · d channels · s ssm state · h heads · p channels of one head)
    u       what goes in                                (b, f, d)
    delta   $\Delta$, how long a frame lasts, > 0       (b, f, d)   one per head in SSD: (b, f, h)
    A       decay rates, < 0                            (d, s)      one per head in SSD: (h,)
    B, C    how a frame is written, and read            (b, f, s)
    D_skip  D, the direct path                          (d,)        (h,) in SSD
    state   h in the paper                              (b, d, s)
"""

import math

import torch
import torch.nn.functional as F
from einops import rearrange
from torch import Tensor, nn

from dancediff.nn.batch_invariant import batch_invariant_softplus


def selective_scan_ref(
    u: Tensor, delta: Tensor, A: Tensor, B: Tensor, C: Tensor, D_skip: Tensor
) -> Tensor:
    r"""The scan as the paper writes it, frame by frame. Read this one.

    $$h_f = e^{\Delta_f A} \odot h_{f-1} + \Delta_f B_f u_f, \qquad y_f = C_f^\top h_f + D\,u_f$$

    Source: Mamba algorithm 2; TCDiff++ eq. 3 (its convolution form, eq. 4, needs fixed A, B, C and
    does not apply here).  B is discretised as $\Delta B$ (Euler), as all Mamba code does.

    Shapes: u, delta (b, f, d), A (d, s), B, C (b, f, s), D_skip (d,) -> (b, f, d).

    >>> one = torch.ones(1, 3, 1)                     # A = -log 2: half is forgotten every frame
    >>> half = torch.tensor([[2.0]]).log().neg()
    >>> selective_scan_ref(one, one, half, one, one, torch.zeros(1)).flatten().tolist()
    [1.0, 1.5, 1.75]
    """
    state = u.new_zeros(u.shape[0], *A.shape)
    y = []
    # unbind, not u[:, f]: autograd would otherwise fill a whole zero tensor for every frame
    for u_f, delta_f, B_f, C_f in zip(*(x.unbind(1) for x in (u, delta, B, C)), strict=True):
        decay = torch.exp(delta_f[..., None] * A)
        state = decay * state + (delta_f * u_f)[..., None] * B_f[:, None]
        y.append((state * C_f[:, None]).sum(-1))
    return torch.stack(y, dim=1) + D_skip * u


class _Scan(torch.autograd.Function):
    r"""The recurrence with its gradient written out, so that no autograd graph grows per frame.

    Backwards in time the same recurrence carries the gradient of the state,

    $$g_f = C_f\, \bar y_f + e^{\Delta_{f+1} A} \odot g_{f+1},$$

    and the gradient of everything else in frame f is read off it. Only the states are kept. Frames
    are worked on in blocks that stay in the processor's cache, so that only what has to wait for
    the frame before, one multiplication and addition, is done frame by frame.
    """

    @staticmethod
    def forward(ctx, v, delta, A, B, C):
        """Frames first: v = delta u, delta (f, b, d), A (s, d), B, C (f, b, s) -> y (f, b, d)."""
        f, b, d = v.shape
        states = v.new_empty(f, b, *A.shape)
        state = v.new_zeros(b, *A.shape)
        for part in _blocks(f, state.numel()):
            torch.mul(B[part, :, :, None], v[part, :, None], out=states[part])
            decays = (delta[part, :, None] * A).exp_()
            for here, decay in zip(states[part].unbind(), decays.unbind(), strict=True):
                state = here.addcmul_(decay, state)
        ctx.save_for_backward(v, delta, A, B, C, states)
        return (C.reshape(f * b, 1, -1) @ states.flatten(0, 1)).reshape(f, b, d)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, grad_y: Tensor):
        """Last frame first."""
        v, delta, A, B, C, states = ctx.saved_tensors
        grad_v, grad_delta = torch.empty_like(v), torch.empty_like(delta)
        grad_A, grad_B = torch.zeros_like(A), torch.empty_like(B)
        later = torch.zeros_like(states[0])  # what frame f gets from f + 1
        for part in reversed(_blocks(len(v), later.numel())):
            grad = C[part, :, :, None] * grad_y[part, :, None]
            decays = (delta[part, :, None] * A).exp_()
            for here, decay in zip(reversed(grad.unbind()), reversed(decays.unbind()), strict=True):
                here.add_(later)
                later = torch.mul(decay, here, out=decay)  # of use once more, below
            grad_v[part] = (B[part, :, None] @ grad)[:, :, 0]
            grad_B[part] = (grad @ v[part, :, :, None])[..., 0]
            first = max(part.start, 1)  # the state before frame 0 is zero: nothing decays
            through_decay = decays[first - part.start :] * states[first - 1 : part.stop - 1]
            grad_delta[first : part.stop] = (through_decay * A).sum(2)
            grad_A += (through_decay * delta[first : part.stop, :, None]).sum((0, 1))
        grad_delta[0] = 0.0
        grad_C = (states.flatten(0, 1) @ grad_y.reshape(-1, grad_y.shape[-1], 1)).reshape(C.shape)
        return grad_v, grad_delta, grad_A, grad_B, grad_C


IN_CACHE = 2**17  # numbers in a block: half a megabyte, of which a handful fit a core's own cache


def _blocks(frames: int, numbers: int) -> list[slice]:
    """Frames in blocks of `IN_CACHE` numbers, ``numbers`` for each frame.

    >>> _blocks(5, IN_CACHE // 2)
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    """
    size = max(1, IN_CACHE // max(1, numbers))
    return [slice(start, min(start + size, frames)) for start in range(0, frames, size)]


def selective_scan(
    u: Tensor, delta: Tensor, A: Tensor, B: Tensor, C: Tensor, D_skip: Tensor
) -> Tensor:
    r"""`selective_scan_ref`, faster: the same loop with the gradient written by hand.

    Differs: nothing but speed.  The official kernel is CUDA only; parallel scans, which look
    cleverer, are several times slower than the loop on a CPU.

    Shapes: as `selective_scan_ref`.

    >>> u, B = torch.randn(2, 9, 4), torch.randn(2, 9, 3)
    >>> inputs = u, torch.rand(2, 9, 4), -torch.rand(4, 3), B, torch.randn(2, 9, 3), torch.ones(4)
    >>> torch.allclose(selective_scan(*inputs), selective_scan_ref(*inputs), atol=1e-5)
    True
    """
    frames_first = (x.transpose(0, 1).contiguous() for x in (delta * u, delta, B, C))
    v, delta, B, C = frames_first
    return _Scan.apply(v, delta, A.mT.contiguous(), B, C).transpose(0, 1) + D_skip * u


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

    >>> u, B = torch.randn(2, 9, 4), torch.randn(2, 9, 3)
    >>> delta, A, ones = torch.rand(2, 9, 2), -torch.rand(2), torch.ones(2)
    >>> wide = lambda x: x.repeat_interleave(2, -1)                # two channels a head
    >>> slow = selective_scan_ref(u, wide(delta), wide(A)[:, None].expand(4, 3), B, B, wide(ones))
    >>> torch.allclose(ssd_scan(u, delta, A, B, B, ones, chunk=4), slow, atol=1e-5)
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


class MambaBlock(nn.Module):
    r"""A selective state space model with its gate: mixes the frames of one stream, past to future.

    $$[u, z] = W_{in} x,\quad u \leftarrow \text{SiLU}(\text{conv}_4(u)),\quad
      [\Delta', B, C] = W_x u,\quad \Delta = \text{softplus}(W_\Delta \Delta' + b)$$
    $$y = \text{scan}(u, \Delta, A, B, C, D),\qquad \text{out} = W_{out}\,(y \odot \text{SiLU}(z))$$

    Source: Mamba section 3.4; TCDiff++ section 3.4 puts one into every decoder layer.
    Differs: ``ssm="ssd"`` ties A and $\Delta$ within a head (Mamba-2), which turns the scan into
    matrix products and is several times faster on a CPU; ``ssm="mamba"`` is the paper's.
    The released TCDiff++ code scans the interleaved frames of all dancers as one long stream and
    replaces the music attention by it; we scan each dancer's own time axis, beside the attention.

    Shapes: x (b, f, d_model) -> (b, f, d_model).

    >>> MambaBlock(16)(torch.randn(2, 9, 16)).shape
    torch.Size([2, 9, 16])
    """

    def __init__(
        self,
        d_model: int,
        *,
        d_state: int = 16,
        expand: int = 2,
        d_conv: int = 4,
        head_dim: int = 64,
        ssm: str = "ssd",
        bidirectional: bool = False,
    ):
        """Learned: four maps, a short filter per channel, decay rates A and the direct path D."""
        super().__init__()
        d_inner = expand * d_model
        if ssm not in ("mamba", "ssd"):
            raise ValueError(f"ssm={ssm!r} is unknown; use 'mamba' or 'ssd'")
        if ssm == "ssd":
            head_dim = min(head_dim, d_inner)
            if d_inner % head_dim:
                raise ValueError(f"head_dim={head_dim} must divide expand * d_model = {d_inner}")
        self.ssm, self.d_state = ssm, d_state
        rates = d_inner if ssm == "mamba" else d_inner // head_dim  # how many different Delta
        self.dt_rank = -(-d_model // 16) if ssm == "mamba" else rates
        self.in_proj = nn.Linear(d_model, 2 * d_inner, bias=False)
        self.conv = nn.Conv1d(d_inner, d_inner, d_conv, groups=d_inner, padding=d_conv - 1)
        self.x_proj = nn.Linear(d_inner, self.dt_rank + 2 * d_state, bias=False)
        self.dt_proj = nn.Linear(self.dt_rank, rates) if ssm == "mamba" else None
        self.dt_bias = None if ssm == "mamba" else nn.Parameter(torch.empty(rates))
        if ssm == "mamba":  # every channel has d_state rates: 1 ... d_state
            A = torch.arange(1.0, d_state + 1).repeat(rates, 1)
        else:  # every head has one, spread over the same range
            A = torch.linspace(1, d_state, rates)
        self.A_log = nn.Parameter(A.log())
        self.D_skip = nn.Parameter(torch.ones(rates))
        self.out_proj = nn.Linear(d_inner, d_model, bias=False)
        self._init_delta()
        options = {"d_state": d_state, "expand": expand, "d_conv": d_conv, "head_dim": head_dim}
        self.reverse = MambaBlock(d_model, ssm=ssm, **options) if bidirectional else None

    @torch.no_grad()
    def _init_delta(self) -> None:
        """Start with frames that last 0.001 to 0.1: softplus(bias) is log-uniform in that range."""
        bias = self.dt_proj.bias if self.ssm == "mamba" else self.dt_bias
        delta = torch.exp(torch.empty_like(bias).uniform_(math.log(1e-3), math.log(1e-1)))
        bias.copy_(delta + torch.log(-torch.expm1(-delta)))  # inverse of softplus

    def forward(self, x: Tensor) -> Tensor:
        """Mix along f; frame f sees frames 0..f (all of them if bidirectional)."""
        f = x.shape[1]
        u, z = self.in_proj(x).chunk(2, dim=-1)
        u = F.silu(self.conv(u.mT)[..., :f].mT)
        dt, B, C = self.x_proj(u).split([self.dt_rank, self.d_state, self.d_state], dim=-1)
        y = self._scan(u, dt, B, C)
        out = self.out_proj(y.to(z.dtype) * F.silu(z))
        return out if self.reverse is None else out + self.reverse(x.flip(1)).flip(1)

    def _scan(self, u: Tensor, dt: Tensor, B: Tensor, C: Tensor) -> Tensor:
        """The recurrence in float32: errors in bfloat16 would pile up over 150 frames."""
        with torch.autocast(u.device.type, enabled=False):
            u, dt, B, C = u.float(), dt.float(), B.float(), C.float()
            A = -self.A_log.float().exp()
            if self.ssm == "mamba":
                delta = F.softplus(F.linear(dt, self.dt_proj.weight, self.dt_proj.bias))
                return selective_scan(u, delta, A, B, C, self.D_skip)
            delta = batch_invariant_softplus(dt + self.dt_bias)
            return ssd_scan(u, delta, A, B, C, self.D_skip)
