r"""Long Group Diffusion Sampling (LGDS): a group dance of any length from a network of 5 seconds.

Read first: notebook 10 · TCDiff++ section 4.4, eq. 19 · `dancediff.diffusion.long_sampling`.

Symbols (axes: n dancers · f frames of a segment · k segments · d motion · m music features)
    root_x   lateral positions in a frame            (n, d) -> (n,)
    S        swap mode, in ranks at the segment's own first frame   (n,)
"""

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.long_sampling import LongSampler, Segment
from dancediff.diffusion.schedule import send
from dancediff.motion.order import check_order, left_to_right, relative_order, swap_mode


@dataclass(frozen=True, kw_only=True)
class LongGroupSampler(LongSampler):
    r"""Each segment starts from the noised end of the one before, its dancers ranked anew.

    $$\hat z_T^{[75:225]} = \big[\hat x_T^{[75:150]},\ z_T^{[150:225]}\big]$$

    The network was trained on dancers ranked left to right at the window's first frame, so they
    are handed over in that order and put back afterwards; nobody is ever renumbered.

    - ``bind(conditions) -> denoise(x_t, t)``: the network, guidance included.
    - ``music`` (k, f, m), standardised, on the network's device: a segment each.
    - ``targets[i]``: the dancers from left to right at the last frame of segment i.
    - everything else: see `LongSampler`.

    Source: TCDiff++ eq. 19 (``pinning="init"``). The released code pastes clean frames at every
    noise level, and loses the first segment, so that dance and music are 2.5 s apart.

    Raises: ValueError for no segment, or targets that are not one order, or None, for each.

    >>> from dancediff.diffusion.samplers import SamplerOptions
    >>> from dancediff.diffusion.schedule import cosine_abar
    >>> def in_a_line(x_t, t):  # a "network" that knows one dance
    ...     return torch.linspace(-0.5, 0.5, x_t.shape[1])[None, :, None, None].expand_as(x_t)
    >>> sampler = LongGroupSampler(shape=(2, 150, 1), bind=lambda conditions: in_a_line,
    ...     music=torch.zeros(3, 150, 35), root_x=lambda frame: frame[:, 0],
    ...     options=SamplerOptions(cosine_abar(), "ddim", 2, eta=1.0),
    ...     overlap=75, pinning="init", seam="fade")
    >>> sampler.dance().shape
    torch.Size([2, 300, 1])
    """

    bind: Callable[[Conditions], Callable[[Tensor, int], Tensor]]
    music: Tensor
    root_x: Callable[[Tensor], Tensor]

    def __post_init__(self):
        super().__post_init__()
        if not len(self.music):
            raise ValueError("music has no segment; give that of at least one")
        if self.targets and len(self.targets) != len(self.music):
            raise ValueError(
                f"targets has {len(self.targets)} entries for {len(self.music)} segments; "
                "give one each, None where nothing is asked"
            )
        targets = [
            target if target is None else check_order(target, self.shape[0], name=f"targets[{i}]")
            for i, target in enumerate(self.targets)
        ]
        object.__setattr__(self, "targets", targets)

    @property
    def num_segments(self) -> int:
        """One for each segment of the music."""
        return len(self.music)

    def rank(self, frame: Tensor) -> Tensor:
        """The dancers from left to right."""
        return left_to_right(self.root_x(frame))

    def swap_mode(self, segment: Segment) -> Tensor:
        """S of a segment (n,): to the order asked for or, if there is none, the one they have."""
        if segment.target is not None:
            return relative_order(segment.target, segment.order)
        if segment.context is None:
            return torch.arange(self.shape[0])
        first, last = (self.root_x(segment.context[:, at]) for at in (0, -1))
        return swap_mode(first, last).cpu()

    def denoiser(self, segment: Segment) -> Callable[[Tensor, int], Tensor]:
        """The network with the music and the swap mode of a segment."""
        return self.bind(self.conditions(segment))

    def conditions(self, segment: Segment) -> Conditions:
        """What the network is given besides the motion, one row."""
        i, S = segment.number, self.swap_mode(segment)
        return Conditions(self.music[i : i + 1], swap=send(S[None], self.music.device))
