r"""Energy condition: how full the music is, frame by frame, for dances that rise and fall with it.

Read first: notebook 02 · `dancediff.music.energy`.

Symbols (axes: b batch · n dancers, where there is a group · f frames)
    e     energy of the music, 0 to 1; nan where it is unknown      (b, f)
    e_u   learned, stands for unknown                               (d_model,)
    h     tokens                                                    (b, n, f, d_model)
"""

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import send
from dancediff.extensions.parts import Part, Pass, part_of

DROP = 0.15  # share of training windows that are learned without their energy


class EnergyCondition(Part):
    r"""Add to every token how much energy the music has in its frame.

    $$h_{nf} \leftarrow h_{nf} + W_2\,\text{SiLU}(w_1 (2 e_f - 1) + b_1) + b_2$$

    Music features say how loud a frame is in one number of 35, relative to all other songs; this
    says it relative to the song, and can be asked for. Rows whose music is masked have no energy.

    Source: ours; no paper has it.

    Shapes: h (b, n, f, d_model) or (b, f, d_model), conditions with energy (b, f) or None -> like
    h.
    Raises: ValueError for an energy of another shape.

    >>> part = EnergyCondition(8)
    >>> conditions = Conditions(torch.zeros(1, 3, 35), energy=torch.tensor([[0.0, torch.nan, 1.0]]))
    >>> part.vectors(conditions, f=3).shape
    torch.Size([1, 3, 8])
    """

    def __init__(self, d_model: int):
        """Learned: two maps and e_u."""
        super().__init__()
        self.into, self.out = nn.Linear(1, d_model), nn.Linear(d_model, d_model)
        self.unknown = nn.Parameter(torch.zeros(d_model))

    def vectors(self, conditions: Conditions, f: int) -> Tensor:
        """What is added to each frame, (b, f, d_model)."""
        e, b = conditions.energy, len(conditions)
        if e is None:
            return self.unknown.expand(b, f, -1)
        if e.shape != (b, f):
            raise ValueError(f"energy has shape {tuple(e.shape)}; expected {(b, f)} to match x_t")
        known = ~e.isnan() & conditions.music_mask[:, None]
        h = self.out(nn.functional.silu(self.into(2 * e.nan_to_num()[..., None] - 1))).float()
        return torch.where(known[..., None], h, self.unknown)

    def tokens(self, h: Tensor, run: Pass) -> Tensor:
        """The same for all dancers."""
        vectors = self.vectors(run.conditions, h.shape[-2])
        return h + vectors.reshape(len(h), *[1] * (h.ndim - 3), *vectors.shape[1:])


def has_energy_condition(model: nn.Module) -> bool:
    """Does a model, or a part of it, have an `EnergyCondition`?"""
    return part_of(model, EnergyCondition) is not None


def with_dropped_energy(energy: Tensor, generator: torch.Generator) -> Tensor:
    """Training curves (b, f) of which a share of rows, `DROP`, becomes nan: unknown.

    >>> g = torch.Generator().manual_seed(0)
    >>> known = with_dropped_energy(torch.ones(10_000, 1), g).isfinite().float().mean().item()
    >>> abs(known - (1 - DROP)) < 0.02
    True
    """
    keep = torch.rand(len(energy), generator=generator) >= DROP
    return energy.masked_fill(~send(keep, energy.device)[:, None], torch.nan)
