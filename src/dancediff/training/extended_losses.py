"""The losses of a training: a paper's terms, and what extensions change and add.

Read first: `dancediff.nn.losses` · a paper's losses, as `dancediff.papers.tcdiffpp.losses`.
"""

from collections.abc import Callable
from dataclasses import replace

from torch import Tensor

from dancediff.extensions.both_guesses import both_guesses
from dancediff.extensions.hard_contact import hard_contact
from dancediff.extensions.joint_velocity_loss import joint_velocity_loss
from dancediff.extensions.level_weights import weigh_rows
from dancediff.extensions.slide_loss import slide_loss
from dancediff.nn.losses import Comparison, with_total
from dancediff.training.config import TrainingExtensions

ADDED = {"joint_velocity_loss": joint_velocity_loss, "slide_loss": slide_loss}


def extended_losses(
    c: Comparison,
    paper: Callable[[Comparison], dict[str, Tensor]],
    weights: dict[str, float],
    *,
    extensions: TrainingExtensions,
    reconstruction: str,
    row_weights: Tensor | None = None,
) -> dict[str, Tensor]:
    """All terms by name, and their weighted sum "total"; without extensions those of the paper.

    ``paper``: its terms, of which ``reconstruction`` names the one of eq. 12 (Lodge: eq. 2);
    ``weights`` those of its terms; ``row_weights`` (b,): see `dancediff.extensions.level_weights`.
    """
    if extensions.hard_contact:
        c = replace(c, contact=hard_contact(c.contact))
    if row_weights is not None:
        c = weigh_rows(c, row_weights)
    terms = paper(c)
    if extensions.both_guesses:
        terms[reconstruction] = both_guesses(c)
    added = {name: getattr(extensions, name) for name in ADDED}
    terms |= {name: ADDED[name](c) for name, weight in added.items() if weight}
    return with_total(terms, weights | added)
