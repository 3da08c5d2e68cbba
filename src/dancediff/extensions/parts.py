"""Parts: what an extension of a network does on the way from noisy motion to a guess.

Read first: `dancediff.papers.tcdiffpp.model`.

An extended model runs its plain decoder step by step and gives every part a turn after each step:
`Parts.prepare` before all, `embed` after the embedding, `tokens` after the Fusion Projection (with
`frame_tokens` before frames are put together, so before it),
`film` before the layers, `read` after the decoder has read out its tokens, `velocity` before and
`adapt` after the Footwork Adaptor.

Symbols (axes: b batch · n dancers, where there is a group · f frames · d motion features)
    h      tokens of the decoder             (b, n, f, d_model) or (b, f, d_model)
    cond   the vector that FiLM gets         (b, d_model)
    x      motion, normalised                (b, n, f, d) or (b, f, d)
"""

from collections.abc import ValuesView
from dataclasses import dataclass
from typing import TypeVar

import torch
from torch import Tensor, nn

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.group_modes import GroupModes
from dancediff.extensions.spectrum import Spectrum
from dancediff.motion.representation import Normalizer

Kind = TypeVar("Kind", bound=nn.Module)


@dataclass
class Pass:
    """One pass through a network: its inputs, and what parts find out for each other."""

    x_t: Tensor
    abar: Tensor  # (b,)
    conditions: Conditions
    normalizer: Normalizer
    group: GroupModes | None = None
    spectrum: Spectrum | None = None  # of the genre; `GenrePrior`
    guess: Tensor = None  # type: ignore[assignment] # the linear guess, like x_t; `LinearStart`


class Part(nn.Module):
    """One extension; a subclass overrides the steps that it takes part in."""

    def prepare(self, run: Pass) -> None:
        """Note in ``run`` what can be said without the network."""

    def embed(self, h: Tensor, run: Pass) -> Tensor:
        """Add to the embedded motion."""
        return h

    def tokens(self, h: Tensor, run: Pass) -> Tensor:
        """Add to the tokens of single frames."""
        return h

    def film(self, cond: Tensor, run: Pass) -> Tensor:
        """Add to the vector that FiLM gets."""
        return cond

    def read(self, x: Tensor, h: Tensor, run: Pass) -> Tensor:
        """Change what the decoder put out; h: its last tokens."""
        return x

    def velocity(self, v: Tensor, x_raw: Tensor, run: Pass) -> Tensor:
        """Add to the velocity that the Footwork Adaptor is conditioned on."""
        return v

    def adapt(self, x_hat: Tensor, x_raw: Tensor, run: Pass) -> Tensor:
        """Change what the Footwork Adaptor made of x_raw."""
        return x_hat


def part_of(model: nn.Module, kind: type[Kind]) -> Kind | None:
    """The first module of a class in a model; None where there is none."""
    return next((part for part in model.modules() if isinstance(part, kind)), None)


class Parts(nn.ModuleDict):
    """Named parts; each step is that of all parts, one after the other."""

    def values(self) -> ValuesView[Part]:
        """The parts; torch knows them as modules only."""
        return super().values()  # type: ignore[return-value]

    def prepare(self, run: Pass) -> Pass:
        """See `Part.prepare`."""
        for part in self.values():
            part.prepare(run)
        return run

    def embed(self, h: Tensor, run: Pass) -> Tensor:
        """See `Part.embed`."""
        for part in self.values():
            h = part.embed(h, run)
        return h

    def tokens(self, h: Tensor, run: Pass) -> Tensor:
        """See `Part.tokens`."""
        for part in self.values():
            h = part.tokens(h, run)
        return h

    def film(self, cond: Tensor, run: Pass) -> Tensor:
        """See `Part.film`."""
        for part in self.values():
            cond = part.film(cond, run)
        return cond

    def read(self, x: Tensor, h: Tensor, run: Pass) -> Tensor:
        """See `Part.read`; in float32, since millimetres need it."""
        with torch.autocast(x.device.type, enabled=False):
            for part in self.values():
                x = part.read(x, h.float(), run)
        return x

    def velocity(self, v: Tensor, x_raw: Tensor, run: Pass) -> Tensor:
        """See `Part.velocity`."""
        for part in self.values():
            v = part.velocity(v, x_raw, run)
        return v

    def adapt(self, x_hat: Tensor, x_raw: Tensor, run: Pass) -> Tensor:
        """See `Part.adapt`."""
        for part in self.values():
            x_hat = part.adapt(x_hat, x_raw, run)
        return x_hat
