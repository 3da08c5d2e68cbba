r"""Cues: dance primitives tell local diffusion where to start, where to end, and what to pass.

Read first: notebook 12 · Lodge section 3.2, appendix B · RePaint eq. 8.

Symbols (axes: l local segments · f frames · d motion features)
    value         the cues, normalised; anything where there is none        (l, f, d)
    hard_frames   first and last 4 of each segment: held at every step      (l, f) bool
    soft_frames   around beats: held in the first share ``soft`` of steps   (l, f) bool
    channels      which features a cue speaks of: all but the root          (d,) bool
    home          a place on the floor, normalised, where segments begin and end    (d,), x and z
    soft          $s$: 0 = hard cues only, 1 = at every step but the last
    times         the sampler's steps, from T - 1 down to -1 ("clean")
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import torch
from torch import Tensor

from dancediff.diffusion.schedule import abar_at, gaussian, q_sample
from dancediff.extensions.border_smoothing import run_in
from dancediff.extensions.constraint import Constraint
from dancediff.extensions.projection import MORE_SIGNAL
from dancediff.motion.representation import LODGE

BORDER = 4  # frames: half a hard primitive


def cue_channels() -> Tensor:
    """Contacts and rotations: where a dancer stands is left to the stitching of the root.

    >>> cue_channels().sum().item(), cue_channels()[LODGE.root].any().item()
    (136, False)
    """
    channels = torch.ones(LODGE.dim, dtype=torch.bool)
    channels[LODGE.root] = False
    return channels


def guided_steps(times: Sequence[int], soft: float) -> int:
    r"""How many steps the soft cues are held for: those from a t above T (1 - s), but not the last.

    $$\#\{k : t_k + 1 > T (1 - s),\; t_{k+1} \ge 0\}$$

    It is the same part of the way from noise to dance for every sampler, and for evenly spaced
    steps the same share of them.

    Source: Lodge section 3.2 ("in the initial 1000 s steps"), its pseudocode and Table 4; the
    sentence in appendix B has 1 - s.  Differs: with DDIM the released code compares t, 999 ... 19,
    with 50 (1 - s), so that 48 or 49 of 50 steps are guided whatever s is.

    Raises: ValueError unless 0 <= soft <= 1.

    >>> from dancediff.diffusion.samplers import sampling_times
    >>> [guided_steps(sampling_times("ddim", 50), s) for s in (0, 0.25, 0.5, 1)]
    [0, 13, 25, 49]
    >>> [guided_steps(sampling_times("ddpm", 50), s) for s in (0, 0.25, 0.5, 1)]
    [0, 250, 500, 999]
    """
    if not 0 <= soft <= 1:
        raise ValueError(f"soft={soft} must lie in 0 (hard cues only) ... 1 (all steps but one)")
    num_steps = times[0] + 1
    return sum(t + 1 > num_steps * (1 - soft) + 1e-6 for t in times[:-2])


def clean_borders(
    x_t: Tensor, x_0: Tensor, *, frames: int = BORDER, channels: Tensor | None = None
) -> Tensor:
    r"""The input of fine-tuning: noisy in the middle, clean at both ends.

    $$x_t'[:4] = x_0[:4], \quad x_t'[-4:] = x_0[-4:], \quad x_t'[4:-4] = x_t[4:-4]$$

    Source: Lodge eq. 10.  Differs: only in the features that hard cues will speak of (``channels``,
    default `cue_channels`), so that training and sampling look alike; all of them, as the paper and
    its code have it: ``channels=torch.ones(139, dtype=torch.bool)``.

    Shapes: x_t, x_0 (..., f, d), channels (d,) -> (..., f, d).
    Raises: ValueError when the borders leave nothing between them.

    >>> mixed = clean_borders(torch.ones(1, 10, 139), torch.zeros(1, 10, 139))
    >>> mixed[0, :, 7].tolist()
    [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]
    >>> mixed[0, :, 4].sum().item()                           # the root stays noisy
    10.0
    """
    f = x_t.shape[-2]
    if not 0 < 2 * frames < f:
        raise ValueError(f"frames={frames} at both ends leave nothing of {f}")
    channels = cue_channels() if channels is None else channels
    border = torch.zeros(f, dtype=torch.bool, device=x_t.device)
    border[:frames] = border[-frames:] = True
    return torch.where(border[:, None] & channels.to(x_t.device), x_0, x_t)


def row_noise(like: Tensor, generators) -> Tensor:
    """Noise of which each row has its own generator, so that rows can be drawn apart.

    ``generators``: one for each row; or a single one, or None, for the whole.

    >>> new = lambda: [torch.Generator().manual_seed(k) for k in range(3)]
    >>> x = torch.zeros(3, 5, 2)
    >>> torch.equal(row_noise(x, new())[1:], row_noise(x[1:], new()[1:]))
    True
    """
    return gaussian(like.shape, generator=generators, device=like.device, dtype=like.dtype)


@dataclass
class CueGuidance:
    r"""Hold local segments at their cues; the ``pin`` and a hook of `samplers.sample`.

    After the step that reached $t'$:

    $$x_{t'} \leftarrow \begin{cases}
      v & \text{at hard cues, whatever } t' \\
      \sqrt{\bar\alpha_{t'}}\, v + \sqrt{1 - \bar\alpha_{t'}}\,\epsilon
        & \text{at soft cues, in the first share } s \text{ of steps}
    \end{cases}$$

    Hard cues are clean because the network was fine-tuned to find its borders so (eq. 10); they are
    there from the first input on. Soft cues have the noise of the rest of the dance.

    With a ``spread`` (a model with preconditioning) `apply` also turns every guess towards the hard
    cues, in the way a dance could turn (`dancediff.extensions.constraint.Constraint`), so that the
    free frames run into them without a jump; with ``bend_soft`` towards the soft cues as well, in
    the steps in which they are held, and with ``home`` towards that place in the first and last
    frame. Windows begin in the middle of the floor; segments that end there too do not add up to a
    walk off the stage. It is never pasted: the network sees it coming and steps there.

    With a spread, guesses that are more signal than noise also run into the hard cues without a
    jerk (`dancediff.extensions.border_smoothing`).

    Source: Lodge section 3.2 and its pseudocode.  Differs: the released code pastes soft cues
    without noise under DDIM, has hard cues only from the second input on, and cannot do a single
    segment; bending is ours.

    Shapes: see the module's symbols.  ``generators``: see `row_noise`.
    Raises: ValueError when shapes differ, or for s outside 0 ... 1.

    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> value = torch.ones(1, 12, 139)
    >>> hard = torch.tensor([[True] * 4 + [False] * 4 + [True] * 4])
    >>> from dancediff.diffusion.samplers import sampling_times
    >>> cues = CueGuidance(value, hard, ~hard & False, cosine_abar(), sampling_times("ddim", 50))
    >>> cues(torch.zeros(1, 12, 139), t_next=-1)[0, :, 7].tolist()
    [1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0, 1.0]
    """

    value: Tensor
    hard_frames: Tensor
    soft_frames: Tensor
    abar: Tensor
    times: Sequence[int]
    soft: float = 1.0
    channels: Tensor = field(default_factory=cue_channels)
    spread: Tensor | None = None
    bend_soft: bool = False
    home: Tensor | None = None
    generators: Sequence[torch.Generator] | torch.Generator | None = None

    def __post_init__(self):
        segments, f, d = self.value.shape
        expected = {"hard_frames": (segments, f), "soft_frames": (segments, f), "channels": (d,)}
        for name, shape in expected.items():
            have = tuple(getattr(self, name).shape)
            if have != shape:
                raise ValueError(f"{name} has shape {have}; expected {shape} to match value")
        self.abar = self.abar.cpu()  # its entries are read as numbers
        steps = guided_steps(self.times, self.soft)
        self._reached = set(self.times[1 : steps + 1])  # t after each guided step
        self._levels = {abar_at(self.abar, t) for t in self.times[:steps]}  # abar before it

    @cached_property
    def hard(self) -> Tensor:
        """Entries held at every step (l, f, d)."""
        return self.hard_frames[..., None] & self.channels

    @cached_property
    def soft_only(self) -> Tensor:
        """Entries held in the first steps (l, f, d); where both speak, the hard cue counts."""
        return (self.soft_frames & ~self.hard_frames)[..., None] & self.channels

    def guided(self, t_next: int) -> bool:
        """Are the soft cues held after the step that reaches ``t_next``?"""
        return t_next in self._reached

    def start(self, x_T: Tensor) -> Tensor:
        """Put the hard cues into the first input (l, f, d)."""
        return self._pasted(self.hard, self.value, x_T)

    def __call__(self, x_next: Tensor, t_next: int) -> Tensor:
        """Hold x_next (l, f, d), which the sampler has just brought to step t_next."""
        if self.guided(t_next):
            eps = row_noise(x_next, self.generators)
            noisy = q_sample(self.value.to(x_next), t_next, self.abar, eps)
            x_next = self._pasted(self.soft_only, noisy, x_next)
        return self._pasted(self.hard, self.value, x_next)

    def apply(self, x0_hat: Tensor, abar: float) -> Tensor:
        """Condition a guess (l, f, d), made at noise level ``abar``, if there is a spread."""
        if self.spread is None:
            return x0_hat
        cues = self._both if self.bend_soft and abar in self._levels else self._hard_only
        x0_hat = cues.condition(x0_hat[None], abar, self.spread)[0]
        if abar < MORE_SIGNAL:
            return x0_hat
        hard, value, frames = self._on_cpu
        return run_in(self._pasted(hard, value, x0_hat), frames)

    @cached_property
    def _on_cpu(self) -> tuple[Tensor, Tensor, Tensor]:
        """The hard cues where `apply` works: entries, values, frames."""
        return self.hard.cpu(), self.value.cpu(), self.hard_frames.cpu()

    @cached_property
    def _hard_only(self) -> Constraint:
        return self._constraint(self.hard)

    @cached_property
    def _both(self) -> Constraint:
        return self._constraint(self.hard | self.soft_only)

    def _constraint(self, mask: Tensor) -> Constraint:
        mask, value = mask.cpu().clone(), self.value.cpu().clone()
        if self.home is not None:
            for end in (0, -1):
                mask[:, end, LODGE.floor], value[:, end, LODGE.floor] = (
                    True,
                    self.home.cpu()[LODGE.floor].to(value),
                )
        return Constraint(mask, value)

    def _pasted(self, mask: Tensor, cue: Tensor, x: Tensor) -> Tensor:
        if x.shape != mask.shape:
            raise ValueError(f"x has shape {tuple(x.shape)}; the cues {tuple(mask.shape)}")
        return torch.where(mask.to(x.device), cue.to(x), x)
