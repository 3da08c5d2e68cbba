r"""How a dance is destroyed: the noise schedule and the forward process.

Read first: notebook 04 · Ho et al. 2020 (DDPM) eq. 4 · Nichol and Dhariwal 2021 eq. 17.

Symbols (axes: b batch · n dancers · f frames · d motion features; t is ALWAYS the noise level)
    x_0    clean motion, normalised to [-1, 1]   (b, n, f, d)
    x_t    the same at noise level t             (b, n, f, d)
    abar   $\bar\alpha_t$, the signal's power    (T,)   almost 1 at t = 0, almost 0 at t = T - 1
    eps    $\epsilon$, Gaussian noise            (b, n, f, d)
"""

import math
from collections.abc import Sequence

import torch
from torch import Tensor

Generators = torch.Generator | Sequence[torch.Generator] | None


def cosine_abar(num_steps: int = 1000) -> Tensor:
    r"""Signal power left after each step of the cosine schedule.

    $$\bar\alpha_t = \prod_{s \le t} (1 - \beta_s), \quad
      \beta_s = \min\!\Big(1 - \frac{g((s+1)/T)}{g(s/T)},\ 0.999\Big), \quad
      g(u) = \cos^2\!\Big(\frac{u + 0.008}{1.008}\cdot\frac{\pi}{2}\Big)$$

    Source: Nichol and Dhariwal 2021, eq. 17; as in the code of EDGE, TCDiff++ and Lodge.

    Shapes: -> (T,) float64, because 1 - abar is as small as 4e-5.
    Raises: ValueError for num_steps < 1.

    >>> abar = cosine_abar(1000)
    >>> f"{abar[499]:.3f} {abar[999]:.2e}"
    '0.494 2.43e-09'
    """
    if num_steps < 1:
        raise ValueError(f"num_steps={num_steps} must be at least 1")
    u = torch.arange(num_steps + 1, dtype=torch.float64) / num_steps
    g = torch.cos((u + 0.008) / 1.008 * math.pi / 2) ** 2
    beta = (1 - g[1:] / g[:-1]).clamp(max=0.999)
    return torch.cumprod(1 - beta, dim=0)


def abar_at(abar: Tensor, t: int) -> float:
    r"""$\bar\alpha_t$ as a number, with $\bar\alpha_{-1} = 1$: step -1 is the clean dance.

    Raises: ValueError for a step outside -1 ... T - 1.

    >>> abar_at(torch.tensor([0.9, 0.5]), -1), abar_at(torch.tensor([0.9, 0.5]), 1)
    (1.0, 0.5)
    """
    if not -1 <= t < len(abar):
        raise ValueError(f"t={t} is outside -1 ... {len(abar) - 1}, the steps of this schedule")
    return 1.0 if t == -1 else float(abar[t])


def check_step(t: int, t_next: int, eta: float) -> None:
    """That a step goes towards the clean dance, with a share of noise that there is.

    Raises: ValueError unless t_next < t and 0 <= eta <= 1.

    >>> check_step(5, 4, eta=1.0)
    """
    if not t_next < t:
        raise ValueError(f"t_next={t_next} must be below t={t}: sampling goes towards -1")
    if not 0 <= eta <= 1:
        raise ValueError(f"eta={eta} must lie in 0 (deterministic) ... 1 (as noisy as DDPM)")


def q_sample(x_0: Tensor, t: int | Tensor, abar: Tensor, eps: Tensor) -> Tensor:
    r"""Jump from the clean dance straight to noise level t.

    $$x_t = \sqrt{\bar\alpha_t}\, x_0 + \sqrt{1 - \bar\alpha_t}\; \epsilon$$

    Source: DDPM eq. 4; Lodge eq. 1; TCDiff++ eq. 1 from level to level.

    Shapes: x_0, eps (b, n, f, d); t an int (-1: clean) or long (b,); abar (T,) -> like x_0.
    Raises: ValueError when eps does not have the shape of x_0; on the CPU also for a t outside of
    the schedule, where -1 in a tensor would count from its end.

    >>> x_0, eps = torch.ones(1, 1, 1, 1), torch.full((1, 1, 1, 1), 2.0)
    >>> round(q_sample(x_0, 0, torch.tensor([0.36]), eps).item(), 4)  # 0.6 * 1 + 0.8 * 2
    2.2
    """
    if eps.shape != x_0.shape:
        raise ValueError(f"eps {tuple(eps.shape)} must have the shape of x_0 {tuple(x_0.shape)}")
    if not isinstance(t, Tensor):
        a = abar_at(abar, t)
        return math.sqrt(a) * x_0 + math.sqrt(1 - a) * eps
    if t.device.type == "cpu" and t.numel() and not 0 <= int(t.min()) <= int(t.max()) < len(abar):
        raise ValueError(f"t={t.tolist()} must lie in 0 ... {len(abar) - 1}; clean is t=-1, an int")
    # The roots are taken in the schedule's precision: 1 - abar loses digits in float32.
    signal, noise = (
        c.to(dtype=x_0.dtype).to(x_0.device)[t].reshape(-1, *(1,) * (x_0.ndim - 1))
        for c in (abar.sqrt(), (1 - abar).sqrt())
    )
    return signal * x_0 + noise * eps


def gaussian(
    shape,
    *,
    generator: Generators = None,
    device: torch.device | str = "cpu",
    dtype: torch.dtype = torch.float32,
) -> Tensor:
    """Standard normal noise that is the same on every device.

    It is drawn on the CPU in float32 and then moved, so a seed means the same dance on a laptop
    and on a GPU (up to rounding inside the network). With a list of generators each draws its own
    row, so that rows can be sampled together or apart.

    Shapes: -> shape.
    Raises: ValueError for what is no generator, one that lives on another device, or not as many as
    rows.

    >>> def new():
    ...     return [torch.Generator().manual_seed(k) for k in range(3)]
    >>> together = gaussian((3, 2), generator=new())
    >>> torch.equal(together[1:], gaussian((2, 2), generator=new()[1:]))
    True
    """
    if isinstance(generator, Sequence):
        if len(generator) != shape[0]:
            raise ValueError(f"{len(generator)} generators for {shape[0]} rows; give one each")
        rows = [gaussian(shape[1:], generator=g, device=device, dtype=dtype) for g in generator]
        return torch.stack(rows)
    if not isinstance(generator, torch.Generator | None):
        kind = type(generator).__name__
        raise ValueError(f"generator is a {kind}; use torch.Generator().manual_seed(a number)")
    if generator is not None and generator.device.type != "cpu":
        raise ValueError(f"generator is on {generator.device}; use torch.Generator() (CPU)")
    return send(torch.randn(tuple(shape), generator=generator).to(dtype), device)


def scaled_noise(sigma: float, like: Tensor, generator: Generators) -> Tensor | float:
    """Draw sigma z, like a tensor; a step without noise leaves the generator untouched.

    >>> scaled_noise(0.0, torch.zeros(2, 3), None)
    0.0
    """
    if sigma == 0:
        return 0.0
    return sigma * gaussian(like.shape, generator=generator, device=like.device, dtype=like.dtype)


def noise_like(x: Tensor, generator: torch.Generator) -> Tensor:
    """Standard normal noise of the shape and on the device of x, for training.

    Drawn where x is: on a GPU by a generator there, which ``generator`` (CPU) seeds. Noise of a
    large batch would take longer to draw on the CPU than the step it is for.

    >>> noise_like(torch.zeros(2, 3), torch.Generator().manual_seed(0)).shape
    torch.Size([2, 3])
    """
    if x.device.type == "cpu":
        return torch.randn(x.shape, generator=generator)
    seed = int(torch.randint(2**62, (1,), generator=generator))
    there = torch.Generator(x.device).manual_seed(seed)
    return torch.randn(x.shape, generator=there, device=x.device)


def send(x: Tensor, device: torch.device | str) -> Tensor:
    """Bring a tensor of the CPU to a device, without waiting for what that is busy with.

    >>> send(torch.ones(2), "cpu").tolist()
    [1.0, 1.0]
    """
    if torch.device(device).type == "cuda":
        return x.pin_memory().to(device, non_blocking=True)
    return x.to(device)
