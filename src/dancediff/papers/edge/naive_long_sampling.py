r"""Naive long sampling: all segments at once, held together by copying and cross-fading.

Read first: `dancediff.diffusion.samplers` · EDGE section 3.4.

Symbols (axes: k segments of the same dance · n dancers · f frames of a segment · F of the dance
         d motion features · m music features)
    x        the segments, as one batch                        (k, n, f, d)
    overlap  frames that a segment shares with its neighbour   75 of 150 in the paper
    w        share of the later segment in a cross-fade        (overlap,), from 0 to 1

It knows nothing of dancers who change places: each segment of a group starts from its own
left-to-right order. Long Group Diffusion Sampling is TCDiff++'s answer to that.
"""

from dataclasses import dataclass
from itertools import pairwise

import torch
from torch import Tensor

from dancediff.motion.blend import cross_fade


@dataclass
class Consistency:
    r"""After every step, a segment starts with the end of the one before.

    $$x_{t'}^{(i)}[0:o] \leftarrow x_{t'}^{(i-1)}[f-o:f]$$

    Both sides have the same noise level, so nothing has to be noised anew. The last step is left
    alone: what still differs there is cross-faded (`join`). Goes where `sample` takes a ``pin``.

    Source: EDGE section 3.4.

    Shapes: x_next (k, n, f, d) -> the same.

    >>> x = torch.arange(2.0)[:, None, None, None].expand(2, 1, 4, 1)
    >>> Consistency(overlap=3)(x, t_next=10)[1].flatten().tolist()
    [0.0, 0.0, 0.0, 1.0]
    """

    overlap: int

    def start(self, x_T: Tensor) -> Tensor:
        """The segments begin as independent noise."""
        return x_T

    def __call__(self, x_next: Tensor, t_next: int) -> Tensor:
        """Copy from the first segment on, so that overlaps of more than half agree as well."""
        if t_next == -1:
            return x_next
        x = x_next.clone()
        for before, after in pairwise(x):
            after[:, : self.overlap] = before[:, -self.overlap :]
        return x


def join(x: Tensor, overlap: int) -> Tensor:
    """Make one dance of segments whose overlaps almost agree, by `cross_fade`.

    Shapes: x (k, n, f, d), metres and 6-D rotations -> (n, f + (k - 1)(f - overlap), d).
    Raises: ValueError for an overlap outside 1 ... f - 1.

    >>> join(torch.randn(3, 2, 150, 151), overlap=75).shape
    torch.Size([2, 300, 151])
    """
    f = x.shape[2]
    if not 1 <= overlap < f:
        raise ValueError(f"overlap={overlap} must lie in 1 ... {f - 1}: a segment has {f} frames")
    dance, *others = x
    for segment in others:
        shared = cross_fade(dance[:, -overlap:], segment[:, :overlap])
        dance = torch.cat([dance[:, :-overlap], shared, segment[:, overlap:]], dim=1)
    return dance
