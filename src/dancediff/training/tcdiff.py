"""What TCDiff's training minimises: the losses of its paths and of its bodies.

Read first: `dancediff.training.objective` · `dancediff.papers.tcdiff.losses`.
"""

from dataclasses import replace
from typing import Any, ClassVar

from torch import Tensor

from dancediff.data.windows import Batch
from dancediff.diffusion.conditions import Conditions
from dancediff.motion.representation import TCDIFFPP
from dancediff.nn.losses import Comparison
from dancediff.papers.tcdiff.losses import TCDiffWeights, body_losses, path_losses
from dancediff.training.objective import GroupObjective, Noised


class TCDiffObjective(GroupObjective):
    """Both stages at the same time: they share no weights, so each learns from its own losses."""

    weights: ClassVar[type] = TCDiffWeights

    def conditions(self, batch: Batch, noised: Noised, **own: Tensor | None) -> Conditions:
        """As for every network, and the true paths."""
        path = batch.x[..., TCDIFFPP.floor]
        return replace(super().conditions(batch, noised, **own), path=path)

    def terms(self, c: Comparison) -> dict[str, Tensor]:
        """Those of the bodies."""
        return body_losses(c)

    def extra_terms(self, model: Any, batch: Batch, noised: Noised, c: Conditions) -> dict:
        """Those of the paths; where in a roll-out follows from the noise level, drawn before."""
        return path_losses(*model.guessed_paths(c.path, c.music, noised.t % model.path_parts))
