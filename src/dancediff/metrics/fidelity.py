r"""FID and Div: does a set of dances look like the reference, and do its dances differ?

Read first: notebook 13 · Lodge, section 4 · AIST++ (where the two began).

Symbols (axes: N samples · M reference samples · d features)
    features   one row for each dance or dancer         (N, d)
    reference  the same of real dances                   (M, d)
    mu, S      mean and covariance of a set              (d,), (d, d)
"""

import torch
from torch import Tensor

from dancediff.metrics.inputs import check_compat

TINY = 1e-8  # a feature whose deviation is below this does not vary
PUBLISHED = 1e-10  # what the public codes add to every deviation
COMPAT = ("lodge", "aist", "gcd")


def fid(features: Tensor, reference: Tensor, *, compat: str | None = None) -> float:
    r"""Frechet distance between a set of features and a reference. Lower is better, 0 is equal.

    $$\mathrm{FID} = \lVert\mu - \mu_r\rVert^2 +
        \operatorname{Tr}\big(S + S_r - 2(S S_r)^{1/2}\big)$$

    of the features after `standardise`. With few samples it is too large: the mean of the set
    is noisy and its covariance flat, so sets of different size cannot be compared. See `too_few`.

    Source: Heusel et al. 2017; standardised as Lodge and AIST++ evaluate.  Differs: a feature
    that is constant in the reference is only centred, see `standardise`, and the root of the
    product is taken exactly also when a covariance is singular, where the public codes add 1e-6
    or 1e-5 to the diagonal on failure. ``compat="lodge"``, ``"aist"`` or ``"gcd"`` scales as they
    do.

    Shapes: features (N, d), reference (M, d), N and M at least 2.
    Raises: ValueError for less than 2 rows, another d, NaN, or an unknown ``compat``.

    >>> x = torch.tensor([[0.0, 1.0], [2.0, 0.0], [1.0, 5.0]])
    >>> round(fid(x, x), 6)
    0.0
    >>> round(fid(x + 1, x), 4)  # the deviations of x are 0.8165 and 2.1602
    1.7143
    """
    x = standardise(features, reference, compat=compat)
    r = standardise(reference, reference, compat=compat)
    return frechet_distance(x.mean(0), x.T.cov(), r.mean(0), r.T.cov())


def diversity(features: Tensor, reference: Tensor, *, compat: str | None = None) -> float:
    r"""How far apart the samples of a set lie; to be compared with that of real dances.

    $$\mathrm{Div} = \frac{2}{N(N-1)} \sum_{i<j} \lVert x_i - x_j\rVert$$

    of the features x after `standardise`. More is not always better: noise is diverse.

    Source: Lodge and AIST++.  Differs: a feature that is constant in the reference is only
    centred; ``compat="lodge"``, ``"aist"`` or ``"gcd"`` scales it too, as they do.

    Shapes: features (N, d), reference (M, d), N and M at least 2.
    Raises: ValueError as `fid`.

    >>> diversity(torch.tensor([[0.0], [1.0], [2.0]]), torch.tensor([[0.0], [2.0]]))
    1.3333333333333333
    """
    return torch.pdist(standardise(features, reference, compat=compat)).mean().item()


def standardise(features: Tensor, reference: Tensor, *, compat: str | None = None) -> Tensor:
    r"""Features in units of how much the reference varies.

    $$x \mapsto (x - \mu_r) / s_r,\qquad s_r^2 = \tfrac1M\textstyle\sum_i (r_i - \mu_r)^2$$

    Source: Lodge's and AIST++'s evaluation.  Differs: they divide by s + 1e-10, so that a feature
    which never changes in the reference (a hand never raised) and does here weighs 10^10 times
    its size and is all that is left of FID and Div. Here such a feature (s under 1e-8) keeps its
    unit. ``compat="lodge"``, ``"aist"`` or ``"gcd"`` divides as they do.

    Shapes: features (N, d), reference (M, d) -> (N, d) float64.
    Raises: ValueError as `fid`.

    >>> reference = torch.tensor([[0.0, 3.0], [4.0, 3.0]])
    >>> standardise(torch.tensor([[4.0, 4.0], [2.0, 3.0]]), reference).tolist()
    [[1.0, 1.0], [0.0, 0.0]]
    """
    check_compat(compat, COMPAT, "FID and Div")
    features, reference = _rows(features, "features"), _rows(reference, "reference")
    if features.shape[1] != reference.shape[1]:
        raise ValueError(
            f"features has {features.shape[1]} columns, reference {reference.shape[1]}; "
            "compute both with the same function and the same joints"
        )
    s, mu = torch.std_mean(reference, dim=0, correction=0)
    s = s + PUBLISHED if compat else torch.where(s < TINY, torch.ones_like(s), s)
    return (features - mu) / s


def frechet_distance(mu1: Tensor, S1: Tensor, mu2: Tensor, S2: Tensor) -> float:
    r"""Frechet (2-Wasserstein, squared) distance of two normal distributions.

    $$\lVert\mu_1 - \mu_2\rVert^2 + \operatorname{Tr} S_1 + \operatorname{Tr} S_2 -
        2\,\lVert S_1^{1/2} S_2^{1/2}\rVert_*,\qquad
      \lVert A\rVert_* = \textstyle\sum \text{singular values}$$

    The last term is the trace of $(S_1 S_2)^{1/2}$, with roots of symmetric matrices only: real,
    and exact for singular covariances too.

    Source: Dowson and Landau 1982.

    Shapes: mu1, mu2 (d,), S1, S2 (d, d), symmetric, no negative eigenvalue.

    >>> one = torch.eye(2)
    >>> round(frechet_distance(torch.zeros(2), one, torch.ones(2), 4 * one), 6)  # 2 + 2 (2 - 1)^2
    4.0
    """
    mu1, S1, mu2, S2 = (x.detach().to("cpu", torch.float64) for x in (mu1, S1, mu2, S2))
    # torch.cov of one feature is a number
    S1, S2 = (S.reshape(mu1.numel(), mu1.numel()) for S in (S1, S2))
    shared = torch.linalg.svdvals(_root(S1) @ _root(S2)).sum()
    distance = (mu1 - mu2).square().sum() + S1.trace() + S2.trace() - 2 * shared
    return distance.clamp_min(0).item()  # rounding


def too_few(features: Tensor, name: str = "features") -> str | None:
    """Why a set is too small for a trustworthy FID, or None when it is not.

    N samples span at most N - 1 dimensions. With no more samples than features the covariance is
    singular, and FID comes out too large by an amount that depends on N.

    Shapes: features (N, d).

    >>> too_few(torch.zeros(20, 72))
    'features: 20 samples for 72 dimensions, so the covariance is singular and FID too large'
    >>> too_few(torch.zeros(73, 72))
    """
    n, d = features.shape
    if n > d:
        return None
    return (
        f"{name}: {n} samples for {d} dimensions, so the covariance is singular and FID too large"
    )


def _root(S: Tensor) -> Tensor:
    """The symmetric square root; eigenvalues below 0 come from rounding only."""
    values, vectors = torch.linalg.eigh((S + S.T) / 2)
    return (vectors * values.clamp_min(0).sqrt()) @ vectors.T


def _rows(x: Tensor, name: str) -> Tensor:
    """A set of features, checked, as float64."""
    x = torch.as_tensor(x).detach().to("cpu", torch.float64)
    if x.ndim != 2 or x.shape[1] == 0:
        raise ValueError(f"{name} has shape {tuple(x.shape)}; expected (samples, features)")
    if len(x) < 2:
        raise ValueError(f"{name} has {len(x)} rows; FID and Div need 2 or more samples")
    if not x.isfinite().all():
        raise ValueError(f"{name} has NaN or infinite values; leave those samples out")
    return x
