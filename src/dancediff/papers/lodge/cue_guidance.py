r"""Cues: dance primitives tell local diffusion where to start, where to end, and what to pass.

Read first: notebook 12 · Lodge section 3.2, appendix B · RePaint eq. 8.

Symbols (axes: l local segments · f frames · d motion features)
    y             the cues, normalised; anything where there is none       (l, f, d)
    hard_frames   first and last 4 of each segment: held at every step     (l, f) bool
    soft_frames   around beats: held in the first share ``soft`` of the    (l, f) bool
                  way from noise to dance
    soft          $s$: 0 = hard cues only, 1 = at every step but the last
    times         noise levels of the sampler's steps, down to -1 ("clean")
"""

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.diffusion.schedule import Generators, gaussian, q_sample
from dancediff.motion.representation import LODGE

BORDER = 4  # frames: half a hard primitive of the paper


def cue_channels() -> Tensor:
    """Contacts and rotations: cues do not say where on the floor a dancer is; (139,) bool.

    >>> cue_channels().sum().item(), cue_channels()[LODGE.root].any().item()
    (136, False)
    """
    channels = torch.ones(LODGE.dim, dtype=torch.bool)
    channels[LODGE.root] = False
    return channels


def guided_steps(times: Sequence[int], soft: float) -> int:
    r"""How many steps the soft cues are held for: where t is at least T (1 - s); never the last.

    $$\#\{k : t_k + 1 > T (1 - s),\; t_{k+1} \ge 0\}$$

    T is one more than the first level. It is the same part of the way from noise to dance for every
    sampler, and for evenly spaced steps the same share of them; DPM-Solver++'s are not.

    Source: Lodge section 3.2 ("in the initial 1000 s steps"), its pseudocode and Table 4; the
    sentence in appendix B has 1 - s.  Differs: with DDIM the released code compares t, 999 ... 19,
    with 50 (1 - s), so that 48 or 49 of 50 steps are guided whatever s is; the pseudocode's i above
    1000 (1 - s) is one step less.

    Raises: ValueError unless 0 <= soft <= 1.

    >>> from dancediff.diffusion.samplers import sampling_times
    >>> [guided_steps(sampling_times("ddim", 50), s) for s in (0, 0.25, 0.5, 1)]
    [0, 13, 25, 49]
    >>> [guided_steps(sampling_times("ddpm", 50), s) for s in (0, 0.25, 0.5, 1)]
    [0, 250, 500, 999]
    >>> [guided_steps(sampling_times("dpm", 20), s) for s in (0.5, 0.75, 1)]
    [9, 11, 19]
    """
    if not 0 <= soft <= 1:
        raise ValueError(f"soft={soft} must lie in 0 (hard cues only) ... 1 (all steps but one)")
    num_steps = times[0] + 1
    return sum(t + 1 > num_steps * (1 - soft) + 1e-6 for t in times[:-2])


def clean_borders(x_t: Tensor, x_0: Tensor, border: int = BORDER) -> Tensor:
    r"""The input of fine-tuning: noisy in the middle, clean at both ends.

    $$x_t'[:4] = x_0[:4], \quad x_t'[-4:] = x_0[-4:], \quad x_t'[4:-4] = x_t[4:-4]$$

    Source: Lodge eq. 10.  Differs: only in the features that hard cues will speak of
    (`cue_channels`), so that training and sampling look alike; the paper and its code take all.

    Shapes: x_t, x_0 (..., f, d) -> (..., f, d).  ``border``: frames, half a hard primitive.
    Raises: ValueError when the borders leave nothing between them.

    >>> mixed = clean_borders(torch.ones(1, 10, 139), torch.zeros(1, 10, 139))
    >>> mixed[0, :, 7].tolist()
    [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    >>> mixed[0, :, 4].sum().item()                           # the root stays noisy
    10.0
    """
    f = x_t.shape[-2]
    if f <= 2 * border:
        raise ValueError(f"x_t has {f} frames; clean borders of {border} leave nothing of them")
    clean = torch.zeros(f, dtype=torch.bool, device=x_t.device)
    clean[:border] = clean[f - border :] = True
    return torch.where(clean[:, None] & cue_channels().to(x_t.device), x_0, x_t)


@dataclass
class CueGuidance:
    r"""Hold local segments at their cues; the ``pin`` of `samplers.sample`.

    After the step that reached $t'$:

    $$x_{t'} \leftarrow \begin{cases}
      y & \text{at hard cues, whatever } t' \\
      \sqrt{\bar\alpha_{t'}}\, y + \sqrt{1 - \bar\alpha_{t'}}\,\epsilon
        & \text{at soft cues, in the first share } s \text{ of the way}
    \end{cases}$$

    Hard cues are clean because the network was fine-tuned to find its borders so (eq. 10; discrete
    primitives lie four frames apart there, not side by side); they are there from the first input
    on. Soft cues have as much noise as the rest of the dance, fresh at every step of any sampler.

    Source: Lodge section 3.2 and its pseudocode, in which hard cues are clean; the text calls that
    inpainting, which noises them.  Differs: pseudocode and code begin after the first step; the
    code pastes soft cues without noise under DDIM and cannot do a single segment.

    Shapes: see the module's symbols.  ``generators``: of the noise, one for each segment or one.
    Raises: ValueError when shapes differ, or for s outside 0 ... 1.

    >>> from dancediff.diffusion.samplers import sampling_times
    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> y = torch.ones(1, 12, 139)
    >>> hard = torch.tensor([[True] * 4 + [False] * 4 + [True] * 4])
    >>> times = sampling_times("ddim", 50)
    >>> cues = CueGuidance(y, hard, ~hard & False, cosine_abar(), times, soft=1.0)
    >>> cues(torch.zeros(1, 12, 139), t_next=-1)[0, :, 7].tolist()
    [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    """

    y: Tensor
    hard_frames: Tensor
    soft_frames: Tensor
    abar: Tensor
    times: Sequence[int]
    soft: float
    generators: Generators = None

    def __post_init__(self):
        for name in ("hard_frames", "soft_frames"):
            have = tuple(getattr(self, name).shape)
            if have != self.y.shape[:2]:
                raise ValueError(f"{name} has shape {have}; expected {tuple(self.y.shape[:2])}")
        channels = cue_channels().to(self.y.device)
        self.abar = self.abar.cpu()  # its entries are read as numbers
        self.hard = self.hard_frames[..., None] & channels  # held at every step (l, f, d)
        # held in the first steps; where both speak, the hard cue counts
        self.soft_only = (self.soft_frames & ~self.hard_frames)[..., None] & channels
        self._reached = set(self.times[1 : guided_steps(self.times, self.soft) + 1])

    def guided(self, t_next: int) -> bool:
        """Are the soft cues held after the step that reaches ``t_next``?"""
        return t_next in self._reached

    def start(self, x_T: Tensor) -> Tensor:
        """Put the hard cues into the first input (l, f, d)."""
        return self._pasted(self.hard, self.y, x_T)

    def __call__(self, x_next: Tensor, t_next: int) -> Tensor:
        """Hold x_next (l, f, d), which the sampler has just brought to step t_next."""
        if self.guided(t_next):
            shape, device = x_next.shape, x_next.device
            eps = gaussian(shape, generator=self.generators, device=device, dtype=x_next.dtype)
            noisy = q_sample(self.y.to(x_next), t_next, self.abar, eps)
            x_next = self._pasted(self.soft_only, noisy, x_next)
        return self._pasted(self.hard, self.y, x_next)

    def _pasted(self, mask: Tensor, cue: Tensor, x: Tensor) -> Tensor:
        if x.shape != mask.shape:
            raise ValueError(f"x has shape {tuple(x.shape)}; the cues {tuple(mask.shape)}")
        return torch.where(mask.to(x.device), cue.to(x), x)
