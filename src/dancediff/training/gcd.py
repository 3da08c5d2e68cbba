"""What GCD's training minimises: geometry, and a contrast between groups and strangers.

Read first: `dancediff.training.objective` · `dancediff.papers.gcd.contrast`.

Symbols (axes: b batch of groups · k negatives of each · n dancers · f frames · d features)
"""

from typing import Any, ClassVar

import torch
from torch import Tensor

from dancediff.data.windows import Batch
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import q_sample
from dancediff.nn.losses import Comparison
from dancediff.papers.gcd.contrast import info_nce, negative_groups
from dancediff.papers.gcd.losses import GCDWeights, geometric_losses
from dancediff.training.objective import GroupObjective, Noised


class GCDObjective(GroupObjective):
    """The losses of GCD, see `dancediff.papers.gcd.losses`."""

    weights: ClassVar[type] = GCDWeights

    @property
    def draws_first(self) -> bool:
        """The contrast draws strangers."""
        return False

    def conditions(self, batch: Batch, noised: Noised, **own: Tensor | None) -> Conditions:
        """As for every network, and a latent."""
        conditions = super().conditions(batch, noised, **own)
        return self.model.with_draws(conditions, noised.generator)

    def terms(self, c: Comparison) -> dict[str, Tensor]:
        """Reconstruction and geometry."""
        return geometric_losses(c)

    def extra_terms(self, model: Any, batch: Batch, noised: Noised, c: Conditions) -> dict:
        """The contrast: groups of the batch against dancers thrown together, equally noisy.

        It is 0 where the batch has one group only.
        """
        x_0, t, b, k = batch.x, noised.t, len(batch.x), self.model.config.negatives
        if b == 1:
            return {"contrast": x_0.new_zeros(())}
        mixed = torch.cat([negative_groups(x_0, noised.generator) for _ in range(k)])
        eps = torch.randn(mixed.shape, generator=noised.generator).to(x_0.device)
        noisy = q_sample(mixed, t.repeat(k), model.abar, eps).to(x_0.dtype)
        w = model.embedding(c, x_0.shape[1]).repeat(1 + k, 1)
        scores = model.critic(torch.cat([noised.x_t, noisy]), w, t.repeat(1 + k))
        return {"contrast": info_nce(scores[:b], scores[b:].reshape(k, b).T)}
