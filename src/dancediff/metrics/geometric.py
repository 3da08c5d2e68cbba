r"""Which poses and moves a dancer uses, and how often: the features of FID_g and Div_g.

Read first: notebook 13 · Lodge, section 4 · AIST++.

Symbols (axes: n dancers · f frames · j joints)
    joints  positions, metres, y up                                    (..., f, j, 3)
    HL, SW, HW   length of an upper arm, width of shoulders and of hips, metres
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from dancediff.metrics.inputs import as_dancers, check_compat
from dancediff.metrics.kinetic import lodge_positions
from dancediff.motion.skeleton import SMPL24

HL, SW, HW = 0.25684, 0.39085, 0.11925
PUBLISHED_FPS = 120.0
COMPAT = ("lodge", "aist")
JOINT = {name: k for k, name in enumerate(SMPL24.names)}


@dataclass(frozen=True)
class Frames:
    """Joints (n, f, j, 3) by name, in frames 1 to f - 1, and how they move from frame to frame.

    Four names are no joints: "zero" is the origin, "up" and "down" lie a metre over and under it,
    "lowest" stands over the origin at the height of a frame's lowest joint. With
    ``three_joint_moves`` the test `move` drops its fourth joint, as the published codes do.
    """

    joints: Tensor
    fps: float
    three_joint_moves: bool

    def at(self, name: str, *, before: bool = False) -> Tensor:
        """Where a joint is, (n, f - 1, 3)."""
        joints = self.joints[:, :-1] if before else self.joints[:, 1:]
        if name in JOINT:
            return joints[:, :, JOINT[name]]
        point = torch.zeros_like(joints[:, :, 0])
        if name == "lowest":
            point[..., 1] = joints[..., 1].amin(-1)
        else:
            point[..., 1] = {"zero": 0.0, "up": 1.0, "down": -1.0}[name]
        return point

    def line(self, a: str, b: str) -> Tensor:
        """From joint a to joint b, (n, f - 1, 3)."""
        return self.at(b) - self.at(a)

    def velocity(self, a: str, b: str) -> Tensor:
        """How fast joint b moves as seen from joint a, (n, f - 1, 3) metres a second."""
        then = self.at(b, before=True) - self.at(a, before=True)
        return (self.line(a, b) - then) * self.fps


def _along(x: Tensor, direction: Tensor) -> Tensor:
    """Length of x along a direction; nan, which passes no test, where there is none."""
    return (x * direction).sum(-1) / direction.norm(dim=-1)


def _normal(m: Frames, a: str, b: str, c: str) -> Tensor:
    return torch.linalg.cross(m.line(a, c), m.line(a, b))


def plane(m: Frames, names, threshold: float) -> Tensor:
    """Joint p lies further than the threshold in front of the plane through a, b and c."""
    a, b, c, p = names
    return _along(m.line(a, p), _normal(m, a, b, c)) > threshold


def nplane(m: Frames, names, threshold: float) -> Tensor:
    """Joint p lies further than the threshold from a, in the direction from n1 to n2."""
    n1, n2, a, p = names
    return _along(m.line(a, p), m.line(n1, n2)) > threshold


def nmove(m: Frames, names, threshold: float) -> Tensor:
    """Joint p moves, as seen from a, faster than the threshold out of the plane a, b, c."""
    a, b, c, p = names
    return _along(m.velocity(a, p), _normal(m, a, b, c)) > threshold


def move(m: Frames, names, threshold: float) -> Tensor:
    """Joint d moves, as seen from c, faster than the threshold in the direction from a to b."""
    a, b, c, d = names
    v = m.velocity(a, c) if m.three_joint_moves else m.velocity(c, d)
    return _along(v, m.line(a, b)) > threshold


def fast(m: Frames, names, threshold: float) -> Tensor:
    """A joint is faster than the threshold."""
    return m.velocity("zero", names[0]).norm(dim=-1) > threshold


def angle(m: Frames, names, limits: tuple[float, float]) -> Tensor:
    """The lines a b and c d enclose an angle between two limits, degrees."""
    a, b, c, d = names
    ab, cd = m.line(a, b), m.line(c, d)
    cosine = _along(ab, cd) / ab.norm(dim=-1)
    degrees = cosine.clamp(-1, 1).acos().rad2deg()
    return (degrees > limits[0]) & (degrees < limits[1])


# name, test, joints, threshold (metres, metres a second or degrees), in the published order
TESTS: tuple[tuple[str, Callable, str, Any], ...] = (
    ("right hand moves back", nmove, "neck rhip lhip rwrist", 1.8 * HL),
    ("left hand moves forward", nmove, "neck lhip rhip lwrist", 1.8 * HL),
    ("right hand over neck", nplane, "chest neck neck rwrist", 0.2 * HL),
    ("left hand over neck", nplane, "chest neck neck lwrist", 0.2 * HL),
    ("right hand moves up", move, "belly chest chest rwrist", 1.8 * HL),
    ("left hand moves up", move, "belly chest chest lwrist", 1.8 * HL),
    ("right elbow bent", angle, "relbow rshoulder relbow rwrist", (0, 110)),
    ("left elbow bent", angle, "lelbow lshoulder lelbow lwrist", (0, 110)),
    ("hands wide apart", nplane, "lshoulder rshoulder lwrist rwrist", 2.5 * SW),
    ("hands approach", move, "lwrist rwrist rwrist lwrist", 1.4 * HL),
    ("left hand to right side", move, "rwrist root lwrist root", 1.4 * HL),
    ("right hand to left side", move, "lwrist root rwrist root", 1.4 * HL),
    ("right hand fast", fast, "rwrist", 2.5 * HL),
    ("left hand fast", fast, "lwrist", 2.5 * HL),
    ("right foot before left leg", plane, "root lhip ltoe rankle", 0.38 * HL),
    ("left foot behind right leg", plane, "root rhip rtoe lankle", 0.38 * HL),
    ("right foot raised", nplane, "zero up lowest rankle", 1.2 * HL),
    ("left foot raised", nplane, "zero up lowest lankle", 1.2 * HL),
    ("feet wide apart", nplane, "lhip rhip lankle rankle", 2.1 * HW),
    ("right knee bent", angle, "rknee rhip rknee rankle", (0, 110)),
    ("left knee bent", angle, "lknee lhip lknee lankle", (0, 110)),
    ("right foot fast", fast, "rankle", 2.5 * HL),
    ("left foot fast", fast, "lankle", 2.5 * HL),
    ("right upper arm off the body", angle, "neck root rshoulder relbow", (25, 180)),
    ("left upper arm off the body", angle, "neck root lshoulder lelbow", (25, 180)),
    ("right thigh off the body", angle, "neck root rhip rknee", (50, 180)),
    ("left thigh off the body", angle, "neck root lhip lknee", (50, 180)),
    ("root before feet and neck", plane, "rankle neck lankle root", 0.5 * HL),
    ("body lies", angle, "neck root zero up", (70, 110)),
    ("right hand low", nplane, "zero down lowest rwrist", -1.2 * HL),
    ("left hand low", nplane, "zero down lowest lwrist", -1.2 * HL),
    ("root fast", fast, "root", 2.3 * HL),
)


def geometric_features(joints: Tensor, *, fps: float = 30.0, compat: str | None = None) -> Tensor:
    r"""One vector for each dancer: in what share of the frames each of 32 tests holds.

    $$g_k = \frac1{f-1} \sum_{i=1}^{f-1} [\,\text{test}_k\text{ holds in frame } i\,]$$

    Read ``TESTS`` for the tests; their lengths are those of the SMPL body, for every body.

    Source: Mueller, Roeder and Clausen 2005, in the selection of AIST++.  Differs: speeds are in
    metres a second at any frame rate, and `move` uses all of its four joints. The published codes
    take every frame for 1/120 s, so that at 30 fps every speed counts four times, and they drop
    the fourth joint: "hand moves up" looks at the chest as seen from the belly and is nearly
    never true, "hands approach" holds when hands part. ``compat="aist"`` does that.
    ``compat="lodge"`` too, with the positions of `lodge_positions`, where tests of root and other
    joints together mean little; Lodge passes 22 joints and the first 1024 frames.

    Shapes: joints (..., f, j, 3) metres, j = 24 or 22 -> (..., 32), each in [0, 1].
    Raises: ValueError for less than 2 frames, NaN, a wrong shape, fps or compat.

    >>> from dancediff.motion.skeleton import SMPL24
    >>> still = torch.zeros(9, 24, 3) + 1.0
    >>> geometric_features(still).sum().item()  # no body, no test passed but "low" hands
    2.0
    """
    check_compat(compat, COMPAT, "geometric features")
    p, lead = as_dancers(joints, fps, least=2)
    if compat == "lodge":
        p = lodge_positions(p)
    m = Frames(p, PUBLISHED_FPS if compat else fps, three_joint_moves=compat is not None)
    passed = [test(m, names.split(), limit) for _, test, names, limit in TESTS]
    return torch.stack(passed, dim=-1).double().mean(1).reshape(*lead, len(TESTS))
