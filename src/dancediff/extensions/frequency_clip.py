r"""Frequency clip: guesses stay within what the training set has, one frequency at a time.

Read first: notebook 06 · `dancediff.extensions.preconditioning`.

With no cut at all, music unlike any in training sent dancers across the stage at 6 m/s.

Symbols (axes: f frames · k frequencies · d motion features)
    mean, std   of each feature, and of each frequency over the training set   (d,), (k, d)
    room        how far from the mean a guess is expected at most              (k, d)
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from dancediff.extensions.formation_prior import FormationPrior
from dancediff.extensions.preconditioning import dct_matrix
from dancediff.lookup import table
from dancediff.motion.representation import TCDIFFPP

LIMIT = 4.0  # standard deviations that a guess may lie from the mean; real dances rarely do


@dataclass(frozen=True)
class FrequencyClip:
    r"""A ``clamp`` of `dancediff.diffusion.samplers.sample`.

    $$\mu + C^\top \operatorname{clip}(C (x - \mu),\ -b,\ b), \qquad b = r + 4\,\sigma$$

    C is a discrete cosine transform over the frames, and r the ``room``: see `room_for_places`.

    Source: ours, in place of the published cut at +-1.  Differs: that leaves fast trembling alone
    and cuts places on the floor, which may lie far out in a long dance.

    >>> clip = FrequencyClip(torch.zeros(1), torch.full((8, 1), 0.5))
    >>> round(clip(torch.full((8, 1), 9.0)).max().item(), 4)
    0.7071
    """

    mean: Tensor
    std: Tensor
    room: Tensor | None = None

    def __call__(self, x: Tensor) -> Tensor:
        """Clip a guess (..., f, d), normalised; shorter windows have fewer frequencies."""
        rows = (torch.arange(x.shape[-2], device=x.device) * len(self.std)) // x.shape[-2]
        C, bound = table(dct_matrix, x.shape[-2], like=x), LIMIT * self.std
        bound = (bound if self.room is None else bound + self.room)[rows]
        coefficients = C @ (x - self.mean)
        return self.mean + C.T @ torch.minimum(torch.maximum(coefficients, -bound), bound)


def room_for_places(formation: FormationPrior, n: int, dim: int) -> Tensor:
    """How far out n dancers are expected, whoever changes places with whom: (k, d).

    ``std`` is that around expected places, so the place itself must be allowed besides.

    Shapes: -> like ``std``, of ``dim`` features, zero but for places on the floor.  Units:
    normalised.

    >>> formation = FormationPrior(max_dancers=2, num_frames=4)
    >>> formation.place[1, :2, 0] = torch.tensor([-1.0, 1.0])
    >>> room_for_places(formation, n=2, dim=151)[0, 4:7]  # 1 m in each of four frames
    tensor([2., 0., 0.])
    """
    stay = torch.arange(n, device=formation.place.device)
    paths = formation.mean(torch.stack([stay, stay.flip(0)]))  # (2, n, f, c): the longest ways
    farthest = (table(dct_matrix, paths.shape[2], like=paths) @ paths).abs().amax((0, 1))
    room = farthest.new_zeros(len(farthest), dim)
    room[:, TCDIFFPP.floor] = farthest
    return room
