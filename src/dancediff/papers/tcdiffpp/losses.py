r"""The five losses of TCDiff++.

Read first: notebook 05 · TCDiff++ section 4.3, eq. 12 to 18 · `dancediff.nn.motion_losses`.

Symbols (axes: b batch · n dancers · f frames · d motion features · j joints)
    x_0          the true motion, normalised                     (b, n, f, d)
    x_raw        the decoder's guess                             (b, n, f, d)
    x_hat        the guess after the Footwork Adaptor            (b, n, f, d)
    joints       forward kinematics of a guess, metres           (b, n, f, j, 3)
"""

from dataclasses import asdict, dataclass

from torch import Tensor

from dancediff.motion.representation import Normalizer
from dancediff.nn.losses import Comparison, between_pairs, compare, mean, with_total
from dancediff.nn.motion_losses import l_contact, l_fk, l_simple, l_vel


@dataclass(frozen=True)
class LossWeights:
    """Weight of each term: TCDiff++ section 5.1.

    >>> LossWeights().terms()["contact"]
    10.942
    """

    simple: float = 0.636  # eq. 12, reconstruction
    vel: float = 2.964  # eq. 14, change from frame to frame
    fk: float = 0.646  # eq. 13, where joints are
    contact: float = 10.942  # eq. 15, feet that stand still
    dist: float = 0.636  # eq. 17, distances between dancers; the released code: 100

    def terms(self) -> dict[str, float]:
        """The weights by the name of their term."""
        return asdict(self)


def l_dist(root_hat: Tensor, root_0: Tensor) -> Tensor:
    r"""Distance consistency: the offsets between dancers should be right.

    $$\tfrac{2}{C(C-1)} \sum_{i<j} \tfrac13 \lVert (p_i - p_j) - (\hat p_i - \hat p_j) \rVert^2$$

    Source: TCDiff++ eq. 16 and 17.  Differs: a mean over frames, pairs and axes where the paper
    sums. The released code compares frames of one dancer under this name (weight 100).

    Shapes: root (b, n, f, 3) metres -> scalar; 0 for a solo.

    >>> import torch
    >>> root = torch.randn(1, 3, 10, 3)
    >>> l_dist(root + 1.0, root).item() < 1e-12                # the whole group shifted: no error
    True
    """
    return mean(between_pairs(root_hat - root_0).square())


def five_losses(c: Comparison) -> dict[str, Tensor]:
    """The terms of eq. 18, unweighted and by name.

    The reconstruction term is taken on the decoder's guess, every other term on the adapted one.
    """
    return {
        "simple": l_simple(c.x_raw, c.x_0),
        "vel": l_vel(c.x_hat, c.x_0),
        "fk": l_fk(c.joints, c.joints_0),
        "contact": l_contact(c.joints, c.contact),
        "dist": l_dist(c.root, c.root_0),
    }


def tcdiffpp_losses(
    x_raw: Tensor,
    x_hat: Tensor,
    x_0: Tensor,
    normalizer: Normalizer,
    *,
    weights: LossWeights | None = None,
) -> dict[str, Tensor]:
    r"""`five_losses` and their weighted sum "total".

    Source: TCDiff++ eq. 18, with the weights of section 5.1 by default.

    Shapes: x_raw, x_hat, x_0 (b, n, f, d) normalised -> dict of scalars.
    Raises: ValueError for other shapes, which would count frames as dancers.

    >>> import torch
    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x = torch.rand(1, 2, 8, 151)
    >>> sorted(tcdiffpp_losses(x, x, x, norm))
    ['contact', 'dist', 'fk', 'simple', 'total', 'vel']
    """
    if x_0.ndim != 4 or not x_raw.shape == x_hat.shape == x_0.shape:
        shapes = ", ".join(
            f"{name} {tuple(x.shape)}"
            for name, x in {"x_raw": x_raw, "x_hat": x_hat, "x_0": x_0}.items()
        )
        raise ValueError(f"{shapes} must all have one shape (b, n, f, d)")
    terms = five_losses(compare(x_raw, x_hat, x_0, normalizer))
    return with_total(terms, (weights or LossWeights()).terms())
