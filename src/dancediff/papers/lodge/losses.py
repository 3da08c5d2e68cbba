r"""The losses of Lodge's two stages, of its fine-tuning, and of its discriminator.

Read first: notebook 12 · Lodge section 3.4, eq. 3 to 10.

Symbols (axes: b batch · f frames · d motion features · j joints · g genres)
    x_0       the true motion, normalised                          (b, f, d)
    x_hat     the guess after the Foot Refine Block                (b, f, d)
    joints    forward kinematics of a guess (eq. 3), metres        (b, f, j, 3)
    contact   predicted contact, about 0..1                        (b, f, 4)
    real, made   the discriminator's logits for true and made dances   (b,)

Every function takes any axes in front of f. Primitives come as (b, 13, 8, d), so that nothing is
compared across the seconds between one primitive and the next.
"""

from dataclasses import asdict, dataclass

import torch
import torch.nn.functional as F
from torch import Tensor

from dancediff.axes import FPS
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.motion.skeleton import feet_of
from dancediff.nn.losses import Comparison, compare, mean, with_total

FORMS = ("hinge", "log")


@dataclass(frozen=True)
class LodgeWeights:
    """Weight of each term; the three ways of training are `coarse`, `local` and `fine_tune`.

    >>> LodgeWeights.local().terms()["foot"]
    20.0
    >>> LodgeWeights.fine_tune(jacc=0.0).jacc
    0.0
    """

    recon: float = 0.636  # eq. 2 and 10; Lodge's code, as are the next three
    vel: float = 2.964  # EDGE's, not in the paper
    joint: float = 1.0  # eq. 4
    foot: float = 20.0  # EDGE's form of eq. 7
    jvel: float = 0.0  # eq. 5, (m/s)^2
    jacc: float = 0.0  # eq. 6, (m/s^2)^2
    contact: float = 0.0  # eq. 7, (m/s)^2
    root_vel: float = 0.0  # the code's "trans", (m/s)^2
    root_acc: float = 0.0  # the same, (m/s^2)^2
    relative: bool = True  # eq. 4 on joints relative to the root, as in the code's second stage
    form: str = "hinge"  # of eq. 9, as in the code; "log": as printed
    genre: float = 0.01  # eq. 9, for the generator
    critic: float = 0.1  # eq. 9, for the discriminator
    diversity: float = 0.01  # the code's: other noise is another style
    focus: float = 0.01  # the code's: like no other genre

    def __post_init__(self):
        """Refuse an unknown form before anything is trained."""
        _known(self.form)

    @classmethod
    def coarse(cls, **changes) -> "LodgeWeights":
        """The first stage; the code has 0.636 for the joints where EDGE has 0.646."""
        return cls(**{"joint": 0.636, "foot": 10.942, "relative": False} | changes)

    @classmethod
    def local(cls, **changes) -> "LodgeWeights":
        """The second stage, as in the code."""
        return cls(**changes)

    @classmethod
    def fine_tune(cls, **changes) -> "LodgeWeights":
        """The second stage with clean borders.

        Differs: eq. 5, 6 and 7, of which the paper gives no weights, weigh 0 in the code; here
        they are on, and small. The code's root acceleration is its velocity once more.
        """
        weights = {
            "foot": 10.0,
            "jvel": 0.05,
            "jacc": 0.05 / FPS**2,
            "contact": 0.05,
            "root_vel": 0.15 / FPS**2,
            "root_acc": 0.3 / FPS**4,
        }
        return cls(**weights | changes)

    def terms(self) -> dict[str, float]:
        """The weights of `lodge_losses`, by the name of their term."""
        other = ("relative", "form", "genre", "critic", "diversity", "focus")
        return {k: v for k, v in asdict(self).items() if k not in other}


def l_recon(x_hat: Tensor, x_0: Tensor) -> Tensor:
    r"""Plain reconstruction: $\operatorname{mean}\,(x_0 - \hat x_0)^2$.

    Source: Lodge eq. 2; in fine-tuning eq. 10, which is the same for an input with clean borders
    (`dancediff.papers.lodge.cue_guidance.clean_borders`).  Differs: all losses are means, where
    the paper prints sums over features.  Shapes: (..., f, d) normalised -> scalar.

    >>> l_recon(torch.ones(2, 3, 4), torch.zeros(2, 3, 4)).item()
    1.0
    """
    return (x_hat - x_0).square().mean()


def l_vel(x_hat: Tensor, x_0: Tensor) -> Tensor:
    r"""Change from frame to frame of everything but the contacts.

    $$\lVert (x_{i+1} - x_i) - (\hat x_{i+1} - \hat x_i) \rVert^2$$

    Source: EDGE eq. 4, in Lodge's code; not in its paper.
    Shapes: (..., f, d) normalised -> scalar.
    """
    moving = slice(LODGE.root.start, None)
    return mean((x_hat - x_0)[..., moving].diff(dim=-2).square())


def l_foot(joints_hat: Tensor, contact: Tensor) -> Tensor:
    r"""A foot that is in contact should not move: $\lVert \dot f_i \cdot b_i \rVert^2$.

    Source: EDGE eq. 5; b is the predicted contact.  Differs: Lodge's code has 1 where it is above
    0.95, else 0; so has `hard_contact`, at 0.5.
    Shapes: joints_hat (..., f, j, 3) metres, contact (..., f, 4) about 0..1 -> scalar, m^2.
    """
    step = feet_of(joints_hat).diff(dim=-3)
    return mean((step * contact[..., :-1, :, None]).square())


def l_joint(joints_hat: Tensor, joints_0: Tensor, *, relative: bool = False) -> Tensor:
    r"""Where the joints are: $\frac1n \sum_i \lVert J_i - \hat J_i \rVert^2$.

    Source: Lodge eq. 4.  Differs: a mean over joints and axes, too, as in all code; ``relative``
    takes positions from the root's, as the code does in the second stage.
    Shapes: (..., f, j, 3) metres -> scalar.

    >>> joints = torch.randn(2, 5, 24, 3)
    >>> l_joint(joints + 1, joints, relative=True).item() < 1e-12
    True
    """
    if relative:
        joints_hat, joints_0 = (J - J[..., :1, :] for J in (joints_hat, joints_0))
    return (joints_hat - joints_0).square().mean()


def l_jvel(joints_hat: Tensor, joints_0: Tensor) -> Tensor:
    r"""How fast the joints move: $\operatorname{mean}\,(\dot J - \hat{\dot J})^2$.

    Source: Lodge eq. 5 (weight 0 in its code).  Differs: see `l_joint`.
    Shapes: (..., f, j, 3) metres -> scalar, (m/s)^2.

    >>> joints = torch.zeros(4, 24, 3)
    >>> moving = joints + torch.arange(4.0)[:, None, None] / FPS
    >>> round(l_jvel(moving, joints).item(), 5)
    1.0
    """
    return mean((FPS * (joints_hat - joints_0).diff(dim=-3)).square())


def l_jacc(joints_hat: Tensor, joints_0: Tensor) -> Tensor:
    r"""How their speed changes: $\operatorname{mean}\,(\ddot J - \hat{\ddot J})^2$.

    It is what makes a dance run smoothly into its pinned borders.

    Source: Lodge eq. 6 (weight 0 in its code).  Differs: see `l_joint`.
    Shapes: (..., f, j, 3) metres -> scalar, (m/s^2)^2.

    >>> joints = torch.zeros(4, 24, 3)
    >>> l_jacc(joints + torch.arange(4.0)[:, None, None], joints).item()       # no acceleration
    0.0
    """
    return mean((FPS**2 * (joints_hat - joints_0).diff(n=2, dim=-3)).square())


def l_contact(joints_hat: Tensor, contact: Tensor) -> Tensor:
    r"""A planted foot neither slides nor sinks.

    $$\operatorname{mean}\,\big((\hat f_{hv} + \hat f_{dv})\, \hat b\big)^2$$

    $f_{hv}$ is the horizontal part of a foot's velocity, $f_{dv}$ its downward part: a foot may
    rise off the floor, but not go through it.

    Source: Lodge eq. 7, after LEMO.  Differs: a mean, see `l_joint`; b is the predicted
    contact, as printed; in the code, whose weight for it is 0, b is 1 where the foot is low.

    Shapes: joints_hat (..., f, j, 3) metres, contact (..., f, 4) -> scalar, (m/s)^2.

    >>> rising = torch.zeros(3, 24, 3)
    >>> rising[..., 1] = torch.arange(3.0)[:, None]
    >>> l_contact(rising, torch.ones(3, 4)).item(), l_contact(-rising, torch.ones(3, 4)).item()
    (0.0, 300.0)
    """
    feet = feet_of(joints_hat)
    lateral, up, depth = (FPS * feet.diff(dim=-3)).unbind(-1)
    velocity = torch.stack([lateral, up.clamp(max=0), depth], dim=-1)
    return mean((velocity * contact[..., :-1, :, None]).square())


def motion_losses(c: Comparison, *, relative: bool) -> dict[str, Tensor]:
    """The terms of eq. 8 but the discriminator's, and four more; unweighted, by name.

    "vel" and "foot" are EDGE's, "root_vel" and "root_acc" are the released code's.

    ``relative``: of `LodgeWeights`.
    """
    root, root_0 = c.root[..., None, :], c.root_0[..., None, :]
    return {
        "recon": l_recon(c.x_hat, c.x_0),
        "vel": l_vel(c.x_hat, c.x_0),
        "joint": l_joint(c.joints, c.joints_0, relative=relative),
        "foot": l_foot(c.joints, c.contact),
        "jvel": l_jvel(c.joints, c.joints_0),
        "jacc": l_jacc(c.joints, c.joints_0),
        "contact": l_contact(c.joints, c.contact),
        "root_vel": l_jvel(root, root_0),
        "root_acc": l_jacc(root, root_0),
    }


def lodge_losses(
    x_hat: Tensor, x_0: Tensor, normalizer: Normalizer, *, weights: LodgeWeights
) -> dict[str, Tensor]:
    r"""`motion_losses` and their weighted sum "total".

    Source: Lodge eq. 8.  Differs: it has the weight 1 for "recon", joints of the whole stage in
    "joint" (``relative=False``), and none of the other terms of `motion_losses`.

    Shapes: (..., f, d) normalised -> dict of scalars.

    >>> norm = Normalizer(-torch.ones(139), torch.ones(139))
    >>> x = torch.rand(2, 8, 139)
    >>> losses = lodge_losses(x, x, norm, weights=LodgeWeights.local(foot=0))
    >>> losses["total"].item()
    0.0
    """
    c = compare(x_hat, x_hat, x_0, normalizer, LODGE)
    return with_total(motion_losses(c, relative=weights.relative), weights.terms())


def l_critic(real: Tensor, made: Tensor, *, form: str = "hinge") -> Tensor:
    r"""What the discriminator minimises: call true dances real, and made ones not.

    $$\tfrac12\,\mathbb E \max(0, 1 - D(x)) + \tfrac12\,\mathbb E \max(0, 1 + D(\hat x))$$

    Source: Lodge's code (hinge); ``form="log"`` is its eq. 9 with $MGD = \sigma(D)$.

    Shapes: real, made (b,) logits of the asked genre -> scalar.
    Raises: ValueError for another form.

    >>> l_critic(torch.tensor([1.0]), torch.tensor([-1.0])).item()        # both told apart
    0.0
    """
    _known(form)
    if form == "log":
        return (F.softplus(-real) + F.softplus(made)).mean()
    return 0.5 * (F.relu(1 - real) + F.relu(1 + made)).mean()


def l_genre(made: Tensor, *, form: str = "hinge") -> Tensor:
    r"""What the generator minimises: be called a real dance of the genre, $-\mathbb E\,D(\hat x)$.

    Source: Lodge's code; ``form="log"``: $-\log \sigma(D)$, the form of eq. 9 whose gradient does
    not vanish while the discriminator is right.

    Shapes: made (b,) -> scalar.

    >>> l_genre(torch.tensor([2.0])).item()
    -2.0
    """
    _known(form)
    return F.softplus(-made).mean() if form == "log" else -made.mean()


def l_diversity(z_a: Tensor, z_b: Tensor, style_a: Tensor, style_b: Tensor) -> Tensor:
    r"""Other noise should be another style.

    $$\frac{\operatorname{mean} |z_a - z_b|}{\operatorname{mean} |s_a - s_b|}$$

    Source: Lodge's code, after MNET.  Shapes: z (b, z), style (b, d_model) -> scalar.

    >>> l_diversity(torch.zeros(1, 4), torch.ones(1, 4), torch.zeros(1, 4), torch.ones(1, 4)).item()
    1.0
    """
    apart = (style_a - style_b).abs().mean(-1).clamp_min(1e-5)
    return ((z_a - z_b).abs().mean(-1) / apart).mean()


def l_focus(made: Tensor, as_other: Tensor) -> Tensor:
    r"""Look like the genre and like no other: $\tfrac12\,\mathbb E[-D_g(\hat x) + D_{g'}(\hat x)]$.

    Source: Lodge's code, after MNET; g' is another genre, drawn at random.  Differs: the released
    code has -D for the other genre too, which asks a dance to look like everything.

    Shapes: made, as_other (b,) -> scalar.

    >>> l_focus(torch.tensor([3.0]), torch.tensor([-1.0])).item()
    -2.0
    """
    return 0.5 * (as_other - made).mean()


def _known(form: str) -> None:
    if form not in FORMS:
        raise ValueError(f"form={form!r} is not one of 'hinge', 'log'")
