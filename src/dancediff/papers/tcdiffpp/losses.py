r"""The five losses of TCDiff++, and two of ours that are off by default.

Read first: notebook 05 · TCDiff++ section 4.3, eq. 12 to 18.

Symbols (axes: b batch · n dancers · f frames · d motion features · j joints)
    x_0          the true motion, normalised                     (b, n, f, d)
    x_raw        the decoder's guess                             (b, n, f, d)
    x_hat        the guess after the Footwork Adaptor            (b, n, f, d)
    joints       forward kinematics of a guess, metres           (b, n, f, j, 3)
"""

from dataclasses import asdict, dataclass

import torch
from einops import rearrange
from torch import Tensor

from dancediff.axes import FPS
from dancediff.motion.representation import TCDIFFPP, Normalizer, unpack
from dancediff.motion.skeleton import feet_of, forward_kinematics


@dataclass(frozen=True)
class LossWeights:
    """Weight of each term, and the two terms that paper and released code write differently.

    >>> LossWeights().terms()["contact"]
    10.942
    """

    simple: float = 0.636  # TCDiff++ section 5.1, as are the next four
    vel: float = 2.964
    fk: float = 0.646
    contact: float = 10.942
    dist: float = 0.636  # the released code: 100, with dist_axis "time"
    joint_vel: float = 0.0  # ours: error of joint velocities, (m/s)^2
    slide: float = 0.0  # ours: foot speed where the TRUE foot is planted, (m/s)^2
    dist_axis: str = "pairs"  # see `l_dist`
    soft_contact: bool = False  # eq. 15 as printed; see `l_contact`

    def terms(self) -> dict[str, float]:
        """The weights alone, by the name of their term."""
        return {k: v for k, v in asdict(self).items() if k not in ("dist_axis", "soft_contact")}


def mean(error: Tensor) -> Tensor:
    """Mean over everything; 0 of nothing, as of the changes from frame to frame of one frame.

    >>> mean(torch.zeros(1, 0)).item()
    0.0
    """
    return error.mean() if error.numel() else error.sum()


def l_simple(x_hat: Tensor, x_0: Tensor) -> Tensor:
    r"""Plain reconstruction: $\mathbb E \lVert x_0 - \hat x_0 \rVert^2$.

    Source: TCDiff++ eq. 12.  Shapes: (b, n, f, d) normalised -> scalar.

    >>> l_simple(torch.ones(1, 2, 3, 4), torch.zeros(1, 2, 3, 4)).item()
    1.0
    """
    return mean((x_hat - x_0).square())


def l_vel(x_hat: Tensor, x_0: Tensor) -> Tensor:
    r"""Change from frame to frame of everything but the contacts.

    $$\lVert (x_{i+1} - x_i) - (\hat x_{i+1} - \hat x_i) \rVert^2$$

    Source: TCDiff++ eq. 14.  Differs: the official code leaves the root out; the paper does not.
    Shapes: (b, n, f, d) normalised -> scalar.

    >>> l_vel(torch.ones(1, 1, 5, 151), torch.zeros(1, 1, 5, 151)).item()    # a constant offset
    0.0
    """
    moving = slice(TCDIFFPP.root.start, None)
    error = x_hat[..., moving].diff(dim=-2) - x_0[..., moving].diff(dim=-2)
    return mean(error.square())


def l_fk(joints_hat: Tensor, joints_0: Tensor) -> Tensor:
    r"""Where the joints end up: $\lVert FK(x_0) - FK(\hat x_0) \rVert^2$.

    Source: TCDiff++ eq. 13.  Differs: in metres; the official code runs FK on normalised values.
    Shapes: (b, n, f, j, 3) metres -> scalar.
    """
    return mean((joints_hat - joints_0).square())


def l_contact(
    joints_hat: Tensor,
    contact_hat: Tensor,
    *,
    threshold: float | None = 0.5,
) -> Tensor:
    r"""A foot that the dancer calls planted should not move.

    $$\lVert (FK(\hat x)_{i+1} - FK(\hat x)_i) \cdot \hat b_i \rVert^2$$

    Source: TCDiff++ eq. 15.  With a ``threshold`` (0..1) the predicted contact is a hard mask, as
    in EDGE's and TCDiff++'s code, in physical units; ``None`` multiplies by it, as in the paper.

    Shapes: joints_hat (b, n, f, j, 3) metres, contact_hat (b, n, f, 4) about 0..1 -> scalar.

    >>> joints = torch.arange(3.0)[None, None, :, None, None].expand(1, 1, 3, 24, 3)
    >>> l_contact(joints, torch.full((1, 1, 3, 4), 0.4)).item()      # nobody claims contact
    0.0
    """
    step = feet_of(joints_hat).diff(dim=-3)
    b = contact_hat[..., :-1, :]
    b = b if threshold is None else (b > threshold).to(b)
    return mean((step * b[..., None]).square())


def l_dist(root_hat: Tensor, root_0: Tensor, *, dist_axis: str = "pairs") -> Tensor:
    r"""Distance consistency: the offsets between dancers should be right.

    $$\tfrac{2}{C(C-1)} \sum_{i<j} \lVert (p_i - p_j) - (\hat p_i - \hat p_j) \rVert^2$$

    Source: TCDiff++ eq. 16 and 17.  Differs: a mean over frames and pairs where the paper sums.
    ``dist_axis`` "adjacent" compares neighbours only (TCDiff v1), "time" compares frames of one
    dancer, which is what the released TCDiff++ does under this name (its weight: 100).

    Shapes: root (b, n, f, 3) metres -> scalar; 0 for a solo.
    Raises: ValueError for another ``dist_axis``.

    >>> root = torch.randn(1, 3, 10, 3)
    >>> l_dist(root + 1.0, root).item() < 1e-12                # the whole group shifted: no error
    True
    """
    n = root_hat.shape[1]
    error = root_hat - root_0
    if dist_axis == "time":
        return mean(error.diff(dim=2).square())
    if dist_axis not in ("pairs", "adjacent"):
        raise ValueError(f"dist_axis={dist_axis!r} is not one of 'pairs', 'adjacent', 'time'")
    if n < 2:
        return error.sum() * 0
    i, j = torch.triu_indices(n, n, 1)
    if dist_axis == "adjacent":
        i, j = torch.arange(n - 1), torch.arange(1, n)
    return mean((error[:, i] - error[:, j]).square())


def tcdiffpp_losses(
    x_raw: Tensor,
    x_hat: Tensor,
    x_0: Tensor,
    normalizer: Normalizer,
    *,
    weights: LossWeights | None = None,
    joints_0: Tensor | None = None,
    weight: Tensor | None = None,
) -> dict[str, Tensor]:
    r"""All terms, unweighted and by name, and their weighted sum "total".

    Source: TCDiff++ eq. 18 (the sum).  The reconstruction term is taken on the raw output, as the
    paper writes it, and on the adapted one, so that both paths learn; every other term is taken
    on the adapted output.  A term of weight 0 is reported and costs no backward pass.

    Shapes: x_raw, x_hat, x_0 (b, n, f, d) normalised; joints_0 (b, n, f, j, 3) metres, if the true
    joints are known already; weight (b,) of each group in every term, see
    `dancediff.extensions.level_weights` -> dict of scalars.

    >>> norm = Normalizer(-torch.ones(151), torch.ones(151))
    >>> x = torch.rand(1, 2, 8, 151)
    >>> sorted(tcdiffpp_losses(x, x, x, norm))
    ['contact', 'dist', 'fk', 'joint_vel', 'simple', 'slide', 'total', 'vel']
    """
    weights = weights or LossWeights()
    contact, root, pose = unpack(normalizer.unnormalize(x_hat.float()))
    joints = forward_kinematics(pose, root)
    with torch.no_grad():  # the truth needs no graph; recording one nearly doubled the time
        contact_0, root_0, pose_0 = unpack(normalizer.unnormalize(x_0.float()))
        joints_0 = forward_kinematics(pose_0, root_0) if joints_0 is None else joints_0
    hard = None if weights.soft_contact else 0.5
    if weight is not None:  # every term is quadratic in these
        root_of = weight.sqrt()[:, None, None, None]
        x_raw, x_hat, x_0 = x_raw * root_of, x_hat * root_of, x_0 * root_of
        root, root_0 = root * root_of, root_0 * root_of
        joints, joints_0 = joints * root_of[..., None], joints_0 * root_of[..., None]
    terms = {
        "simple": 0.5 * (l_simple(x_raw, x_0) + l_simple(x_hat, x_0)),
        "vel": l_vel(x_hat, x_0),
        "fk": l_fk(joints, joints_0),
        "contact": l_contact(joints, contact, threshold=hard),
        "dist": l_dist(root, root_0, dist_axis=weights.dist_axis),
        "joint_vel": l_fk(joints.diff(dim=2) * FPS, joints_0.diff(dim=2) * FPS),
        "slide": l_contact(joints * FPS, contact_0),
    }
    used = {name: w for name, w in weights.terms().items() if w}
    terms["total"] = sum((w * terms[name] for name, w in used.items()), x_hat.new_zeros(()))
    return terms


def pair_distances(root: Tensor) -> Tensor:
    """Distance of every pair of dancers in every frame, (b, n, f, 3) -> (b, f, n, n) metres.

    >>> pair_distances(torch.zeros(1, 3, 7, 3)).shape
    torch.Size([1, 7, 3, 3])
    """
    by_frame = rearrange(root, "b n f x -> b f n x")
    return torch.cdist(by_frame, by_frame)
