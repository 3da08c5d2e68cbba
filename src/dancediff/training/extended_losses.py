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
from dancediff.own import own_function
from dancediff.training.config import TrainingExtensions

OWN = "own_loss"
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
    if extensions.own_loss is not None:
        added[OWN] = extensions.own_loss_weight
        terms[OWN] = _own_term(extensions.own_loss, c)
    return with_total(terms, weights | added)


def _own_term(name: str, c: Comparison) -> Tensor:
    """The term of a function of the user's own.

    Raises: ValueError when it fails, or returns anything but one number that follows from the
    guess.
    """
    function = own_function(name, OWN)
    try:
        term = function(c)
    except Exception as err:  # the user's function may fail in any way
        raise ValueError(f"own_loss={name!r} fails: {type(err).__name__}: {err}") from err
    if not isinstance(term, Tensor) or term.shape != ():
        what = tuple(term.shape) if isinstance(term, Tensor) else type(term).__name__
        raise ValueError(f"own_loss={name!r} returned {what}; it must be a tensor of one number")
    if c.x_hat.requires_grad and not term.requires_grad:
        raise ValueError(f"own_loss={name!r} does not depend on the guess; use c.x_hat or c.joints")
    return term
