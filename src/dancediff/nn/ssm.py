r"""State space models: a memory that is updated once per frame.

Read first: notebook 08 · TCDiff++ section 3.4 · Gu & Dao 2023 (Mamba) algorithm 2.

Symbols (axes: b batch · f frames · d channels · s ssm state)
    u       what goes in                                (b, f, d)
    delta   $\Delta$, how long a frame lasts, > 0       (b, f, d)
    A       decay rates, < 0                            (d, s)
    B, C    how a frame is written, and read            (b, f, s)
    D_skip  D, the direct path                          (d,)
    state   h in the paper                              (b, d, s)
"""

import math

import torch
import torch.nn.functional as F
from torch import Tensor, nn

from dancediff.nn.attention import full_precision


def selective_scan_ref(
    u: Tensor, delta: Tensor, A: Tensor, B: Tensor, C: Tensor, D_skip: Tensor
) -> Tensor:
    r"""The scan as Mamba writes it, frame by frame. Read this one.

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
        return (C.flatten(0, 1)[:, None] @ states.flatten(0, 1)).reshape(f, b, d)

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
        grad_C = (states.flatten(0, 1) @ grad_y.flatten(0, 1)[..., None]).reshape(C.shape)
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

    Differs: in speed only, but a gradient of a gradient needs `selective_scan_ref`.  The official
    kernel is CUDA only; parallel scans, which look cleverer, are several times slower than the loop
    on a CPU.

    Shapes: as `selective_scan_ref`.

    >>> u, B = torch.randn(2, 9, 4), torch.randn(2, 9, 3)
    >>> inputs = u, torch.rand(2, 9, 4), -torch.rand(4, 3), B, torch.randn(2, 9, 3), torch.ones(4)
    >>> torch.allclose(selective_scan(*inputs), selective_scan_ref(*inputs), atol=1e-5)
    True
    """
    frames_first = (x.transpose(0, 1).contiguous() for x in (delta * u, delta, B, C))
    v, delta, B, C = frames_first
    return _Scan.apply(v, delta, A.mT.contiguous(), B, C).transpose(0, 1) + D_skip * u


class MambaBlock(nn.Module):
    r"""A selective state space model with its gate: mixes the frames of one stream, past to future.

    $$[u, z] = W_{in} x,\quad u \leftarrow \text{SiLU}(\text{conv}_4(u)),\quad
      [\Delta', B, C] = W_x u,\quad \Delta = \text{softplus}(W_\Delta \Delta' + b)$$
    $$y = \text{scan}(u, \Delta, A, B, C, D),\qquad \text{out} = W_{out}\,(y \odot \text{SiLU}(z))$$

    Source: Mamba section 3.4; TCDiff++ section 4.1 puts one into every decoder layer.

    Shapes: x (b, f, d_model) -> (b, f, d_model).

    >>> MambaBlock(16)(torch.randn(2, 9, 16)).shape
    torch.Size([2, 9, 16])
    """

    def __init__(self, d_model: int, *, d_state: int = 16, expand: int = 2, d_conv: int = 4):
        """Learned: four maps, a short filter per channel, decay rates A and the direct path D."""
        super().__init__()
        d_inner, dt_rank = expand * d_model, -(-d_model // 16)
        self.d_state = d_state
        self.in_proj = nn.Linear(d_model, 2 * d_inner, bias=False)
        self.conv = nn.Conv1d(d_inner, d_inner, d_conv, groups=d_inner, padding=d_conv - 1)
        self.x_proj = nn.Linear(d_inner, dt_rank + 2 * d_state, bias=False)
        self.dt_proj = nn.Linear(dt_rank, d_inner)
        init_delta(self.dt_proj.bias)
        A = torch.arange(1.0, d_state + 1).repeat(d_inner, 1)
        self.A_log = nn.Parameter(A.log())
        self.D_skip = nn.Parameter(torch.ones(d_inner))
        self.out_proj = nn.Linear(d_inner, d_model, bias=False)

    def forward(self, x: Tensor) -> Tensor:
        """Mix along f; frame f sees frames 0..f."""
        f = x.shape[1]
        u, z = self.in_proj(x).chunk(2, dim=-1)
        u = F.silu(self.conv(u.mT)[..., :f].mT)
        dt_rank = self.x_proj.out_features - 2 * self.d_state
        dt, B, C = self.x_proj(u).split([dt_rank, self.d_state, self.d_state], dim=-1)
        with torch.autocast(u.device.type, enabled=False):  # errors of bfloat16 would pile up
            y = self.scan(*(full_precision(part) for part in (u, dt, B, C)))
        return self.out_proj(y.to(z.dtype) * F.silu(z))

    def scan(self, u: Tensor, dt: Tensor, B: Tensor, C: Tensor) -> Tensor:
        """The recurrence, in float32."""
        delta = F.softplus(self.dt_proj(dt))
        return selective_scan(u, delta, -self.A_log.exp(), B, C, self.D_skip)


@torch.no_grad()
def init_delta(bias: Tensor) -> None:
    """Start with frames that last 0.001 to 0.1: softplus(bias) is log-uniform in that range."""
    delta = torch.exp(torch.empty_like(bias).uniform_(math.log(1e-3), math.log(1e-1)))
    bias.copy_(delta + torch.log(-torch.expm1(-delta)))  # inverse of softplus
