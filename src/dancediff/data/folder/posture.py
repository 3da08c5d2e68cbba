r"""What a recording does not say of itself: joints, up axis, unit, frame rate, upright rest pose.

Read first: `dancediff.data.folder.tree` · `dancediff.data.joint_maps`.

Each is found from the body itself unless it is given, and each that is in doubt is told: a person
is upright most of the time, has legs of 0.6 to 1.2 m, and toes that point to the front.

Symbols (axes: f frames · j joints)
    up    the axis of the file that points up: "x", "y", "z", or with a "-" before it
    unit  metres to one unit of the file
"""

import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import torch
from torch import Tensor

from dancediff.data.bvh import BVH
from dancediff.data.folder.guess import guess_joints, longest_branch, side_of
from dancediff.data.folder.tree import rest_at
from dancediff.data.joint_maps import MAPS, find_joints
from dancediff.motion.rotation import rotation_about, rotation_angle
from dancediff.motion.skeleton import SMPL24

SPINES = ("belly", "spine", "chest")
UPS = {  # axis: what turns it to y
    "y": ("x", 0.0), "z": ("x", -90.0), "x": ("z", 90.0),
    "-y": ("x", 180.0), "-z": ("x", 90.0), "-x": ("z", -90.0),
}  # fmt: skip
UNITS = (1.0, 0.1, 0.01, 0.001, 0.0254, 0.3048, 0.0254 / 0.45)  # CMU's own unit is the last
LEG = (0.6, 1.2)  # metres from hip to ankle
ADULT = 0.85
RATES = (24.0, 25.0, 30.0, 50.0, 60.0, 90.0, 100.0, 120.0, 200.0, 240.0)
NEAR_RATE = 0.012  # 0.033 s a frame is meant as 1/30 s
NTSC = 1.001  # by how much video is slower: 29.97 a second is no 30
UPRIGHT = 0.7  # mean of a body that mostly stands, along the axis that points up
LOOK = 300  # frames at which a posture is looked at
MOST_LEAD = 0.25  # seconds that a T-pose put before a take may take to fade
LEAD_SPEED = 6.0  # radians a second of the mean joint: no dancer leaves a T-pose so fast


@dataclass(frozen=True)
class Given:
    """What the user says of a recording; None is found."""

    joints: str | dict[str, str] | None = None
    up: str | None = None
    unit: float | None = None
    fps: float | None = None
    rest: str | int | None = None  # "file", or the frame of a T-pose

    def __post_init__(self):
        if self.up is not None and self.up not in UPS:
            raise ValueError(f"up={self.up!r} is not one of {', '.join(UPS)}")
        for name in ("unit", "fps"):
            value = getattr(self, name)
            number = isinstance(value, int | float) and math.isfinite(value) and value > 0
            if value is not None and not number:
                raise ValueError(f"{name}={value!r} must be a positive number")
        if not (self.rest in (None, "file") or (type(self.rest) is int and self.rest >= 0)):
            raise ValueError(f'rest={self.rest!r} must be "file" or the number of a frame')


@dataclass
class Found:
    """A recording in metres, y up, on an upright rest pose, and what was found out for it."""

    bvh: BVH
    joints: dict[str, str]
    facts: dict = field(default_factory=dict)  # joints, up, unit, fps, rest: as `Given` takes them
    lead: int = 0  # frames of a T-pose that was put before the take, and that fade from it
    repaired: list[str] = field(default_factory=list)
    doubts: list[str] = field(default_factory=list)


def settle(bvh: BVH, given: Given) -> Found:
    """Find joints, up axis, unit, rate and rest pose of a recording read in its own unit.

    Raises: ValueError telling what cannot be found and how to give it.
    """
    found = Found(bvh, {})
    found.bvh, fps = _rate(bvh, given, found)
    found.facts |= _joints(found, given)
    up = given.up or _up(found)
    axis, degrees = UPS[up]
    turn = rotation_about(axis, torch.tensor(math.radians(degrees), dtype=torch.float64))
    found.bvh = _turned(found.bvh, turn)
    found.facts |= {"up": up, "fps": fps, "rest": _rest(found, given)}
    found.bvh = _scaled(found, given)
    found.lead = _lead(found)
    _check_sides(found)
    return found


def _rate(bvh: BVH, given: Given, found: Found) -> tuple[BVH, float]:
    fps = given.fps or bvh.fps
    near = min(RATES, key=lambda rate: abs(rate - fps))
    video = abs(near / NTSC - fps) < 1e-4 * near
    if given.fps is None and not video and 0 < abs(near - fps) < NEAR_RATE * near:
        if abs(near - fps) > 1e-3 * near:
            found.repaired.append(f"{fps:.2f} frames a second are taken as {near:g}")
        fps = near
    if not 20 <= fps <= 250:
        found.doubts.append(f"{fps:g} frames a second is an odd rate; give fps")
    return replace(bvh, fps=float(fps)), float(fps)


def _joints(found: Found, given: Given) -> dict:
    """The map, and how it came about: given, the name of a known map, or guessed."""
    bvh = found.bvh
    if given.joints is not None:
        found.joints = find_joints(bvh.names, given.joints)
        return {"map": given.joints if isinstance(given.joints, str) else "given"}
    known = {}
    for label in MAPS:
        try:
            known[label] = find_joints(bvh.names, label)
        except ValueError:
            continue
    known = {label: joints for label, joints in known.items() if _is_a_body(bvh, joints)}
    if known:
        label = max(known, key=lambda one: len(known[one]))  # the first of equals
        found.joints = known[label]
    else:
        label = "guessed"
        found.joints = _guess(bvh)
        found.doubts.append("its joints were guessed from how they branch; check folder.toml")
    found.joints = _completed(bvh, found.joints)
    return {"map": label}


def _completed(bvh: BVH, joints: dict[str, str]) -> dict[str, str]:
    """The map with root, spine, hands and toes by their places, whatever their names."""
    # a joint that stands still on the floor is often called root
    root = _common_parent(bvh, *(joints[side + "hip"] for side in "lr"))
    joints = {ours: name for ours, name in joints.items() if ours not in SPINES} | {"root": root}
    above = _above(bvh, joints["neck"])
    middle = above[: above.index(root)][::-1] if root in above else []
    joints |= dict(zip(SPINES[:2], middle, strict=False))
    if len(middle) > 2:
        joints |= {"spine": middle[len(middle) // 2], "chest": middle[-1]}
    for side, (end, of) in itertools.product("lr", (("toe", "ankle"), ("hand", "wrist"))):
        tip = longest_branch(bvh, joints[side + of])
        if side + end not in joints and tip is not None:
            joints[side + end] = tip
    return {ours: joints[ours] for ours in SMPL24.names if ours in joints}


def _guess(bvh: BVH) -> dict[str, str]:
    """From the rest pose, else from the first frame: whichever shows a body."""
    reasons = []
    shows: tuple[Callable[[], Tensor], ...] = (bvh.rest, lambda: bvh.world()[0][0])
    for show in shows:
        try:
            joints = guess_joints(bvh, show())
            if _is_a_body(bvh, joints):
                return joints
            reasons.append("what was guessed is no body")
        except (ValueError, StopIteration) as err:
            reasons.append(str(err))
    names = ", ".join(bvh.names[:40])
    raise ValueError(
        f"which joint is which cannot be found ({reasons[0]}) among {names}; "
        "give joints in folder.toml"
    )


def _is_a_body(bvh: BVH, joints: dict[str, str]) -> bool:
    """Do the joints of each limb hang on each other, and on no other limb?"""
    chains = [("neck", "head")]
    for side in "lr":
        chains += [(f"{side}hip", f"{side}knee"), (f"{side}knee", f"{side}ankle")]
        chains += [(f"{side}shoulder", f"{side}elbow"), (f"{side}elbow", f"{side}wrist")]
    above = {ours: _above(bvh, name) for ours, name in joints.items()}
    hang = all(joints[a] in above[b] for a, b in chains)
    parts = [joints[side + part] for side in "lr" for part in ("hip", "shoulder")]
    return hang and not any(a in _above(bvh, b) for a in parts for b in parts)


def _above(bvh: BVH, name: str) -> list[str]:
    row, j = [], bvh.parents[bvh.index(name)]
    while j >= 0:
        row.append(bvh.names[j])
        j = bvh.parents[j]
    return row


def _common_parent(bvh: BVH, a: str, b: str) -> str:
    over = _above(bvh, b)
    return next(name for name in _above(bvh, a) if name in over)


def _up(found: Found) -> str:
    """The axis along which this body is longest, from ankles to neck, on average."""
    bvh, joints = found.bvh, found.joints
    step = max(1, bvh.num_frames // LOOK)
    some = replace(bvh, rotations=bvh.rotations[::step], translations=bvh.translations[::step])
    points = some.world()[0]
    at = {ours: points[:, bvh.index(name)] for ours, name in joints.items()}
    name = up_axis(at["neck"] - (at["lankle"] + at["rankle"]) / 2, found.doubts)
    if name not in ("y", "z"):
        found.doubts.append(f"{name} was taken as up, which is rare; else give up")
    return name


def up_axis(body: Tensor, doubts: list[str]) -> str:
    """The axis along which vectors from ankles to neck (..., 3) point on average.

    ``doubts`` gets a line where the body seldom points along any.

    >>> doubts = []
    >>> up_axis(torch.tensor([[0.0, 0.1, -1.4]]), doubts), doubts
    ('-z', [])
    """
    mean = torch.nn.functional.normalize(body, dim=-1).reshape(-1, 3).mean(0)
    axis = int(mean.abs().argmax())
    name = ("-" if mean[axis] < 0 else "") + "xyz"[axis]
    if mean[axis].abs() < UPRIGHT:
        doubts.append(f"the body is seldom upright; {name} was taken as up, else give up")
    return name


def _turned(bvh: BVH, turn: Tensor) -> BVH:
    """The whole recording turned in the world."""
    rotations, moves = bvh.rotations.clone(), bvh.translations.clone()
    rotations[:, 0] = turn @ rotations[:, 0]
    moves[:, 0] = moves[:, 0] @ turn.T
    return replace(bvh, rotations=rotations, translations=moves)


def _rest(found: Found, given: Given) -> str | int:
    """Give the recording a rest pose in which the body is upright: the file's own, or a frame's."""
    if given.rest == "file" or (given.rest is None and _upright(found, found.bvh.rest())):
        return "file"
    bvh = found.bvh
    if given.rest is not None:
        frame = int(given.rest)
        if frame >= bvh.num_frames:
            raise ValueError(f"rest={frame} is no frame; the recording has {bvh.num_frames}")
    else:
        frame = _most_like_a_t(found)
        found.repaired.append(f"its rest pose is no upright body; that of frame {frame} is taken")
    found.bvh = rest_at(bvh, frame)
    return frame


def _at(found: Found, points: Tensor) -> dict[str, Tensor]:
    return {ours: points[..., found.bvh.index(name), :] for ours, name in found.joints.items()}


def _t_likeness(at: dict[str, Tensor]) -> Tensor:
    """1 for a T-pose, less for others: arms to the sides, legs down, spine up; any facing."""
    unit = torch.nn.functional.normalize
    up = unit(at["neck"] - (at["lhip"] + at["rhip"]) / 2, dim=-1)
    left = unit(at["lshoulder"] - at["rshoulder"], dim=-1)
    score = unit(at["lhip"] - at["rhip"], dim=-1).mul(left).sum(-1)
    for side, sign in (("l", 1.0), ("r", -1.0)):
        leg = unit(at[f"{side}ankle"] - at[f"{side}hip"], dim=-1)
        arm = unit(at[f"{side}wrist"] - at[f"{side}shoulder"], dim=-1)
        score = score - (leg * up).sum(-1) + sign * (arm * left).sum(-1)
    return score / 5


def _upright(found: Found, rest: Tensor) -> bool:
    """Is the rest pose a body with the legs down and the arms not above the head?"""
    at = _at(found, rest)
    unit = torch.nn.functional.normalize
    across, spine = at["lshoulder"] - at["rshoulder"], at["neck"] - (at["lhip"] + at["rhip"]) / 2
    if torch.linalg.cross(unit(across, dim=0), unit(spine, dim=0)).norm() < 0.5:
        return False
    up = unit(spine, dim=0)
    legs = min(-unit(at[s + "ankle"] - at[s + "hip"], dim=0) @ up for s in "lr")
    arms = max(unit(at[s + "wrist"] - at[s + "shoulder"], dim=0) @ up for s in "lr")
    return bool(legs > 0.8 and arms < 0.7 and (at["lhip"] - at["rhip"]) @ across > 0)


def _most_like_a_t(found: Found) -> int:
    """The first frame if it is a T-pose, else the one most like it."""
    likeness = _t_likeness(_at(found, found.bvh.world()[0]))
    frame = 0 if likeness[0] > 0.9 else int(likeness.argmax())
    if likeness[frame] < 0.9:
        found.doubts.append(f"no frame is a T-pose; {frame} is the nearest, else give rest")
    return frame


def _scaled(found: Found, given: Given) -> BVH:
    """The recording in metres."""
    rest = _at(found, found.bvh.rest())
    leg = sum(
        (rest[side + a] - rest[side + b]).norm().item() / 2
        for side in "lr"
        for a, b in (("hip", "knee"), ("knee", "ankle"))
    )
    if not leg > 1e-9:
        raise ValueError("its legs have no length: the OFFSETs are zero")
    unit = given.unit
    if unit is None:
        fits = [u for u in UNITS if LEG[0] <= u * leg <= LEG[1]]
        if fits:
            unit = min(fits, key=lambda u: abs(math.log(u * leg / ADULT)))
        else:
            unit = ADULT / leg
            found.doubts.append(f"legs of {leg:.4g} units fit no known unit; give unit")
    found.facts["unit"] = unit
    bvh = found.bvh
    return replace(bvh, offsets=bvh.offsets * unit, translations=bvh.translations * unit)


def _lead(found: Found) -> int:
    bvh, most = found.bvh, round(MOST_LEAD * found.bvh.fps)
    if bvh.num_frames < 4 * most:
        return 0
    first = bvh.frames(0, most + 2)
    used = [bvh.index(name) for name in found.joints.values()]
    R = first.rotations[:, used]
    speed = rotation_angle(R[:-1].mT @ R[1:]).mean(1) * bvh.fps
    fast = (speed > LEAD_SPEED).nonzero()[:, 0]
    if len(fast) == 0 or _t_likeness(_at(found, first.world()[0][:1]))[0] < 0.9:
        return 0
    return int(fast.max()) + 1


def _check_sides(found: Found) -> None:
    """Tell when left and right seem to be exchanged: feet that point backward, other names."""
    joints, at = found.joints, _at(found, found.bvh.rest())
    told = [side_of(joints[side + part]) for side in "lr" for part in ("hip", "elbow")]
    if told == ["r", "r", "l", "l"]:
        found.doubts.append("names of the left joints say right; check joints in folder.toml")
    if "ltoe" in at and "rtoe" in at:
        check_toes(at, found.doubts)


def check_toes(at: dict[str, Tensor], doubts: list[str]) -> None:
    """Add a doubt where toes mostly point backward; ``at`` has the places (..., 3) of joints."""
    up = at["neck"] - (at["lhip"] + at["rhip"]) / 2
    front = torch.linalg.cross(at["lhip"] - at["rhip"], up)
    feet = torch.stack([at[s + "toe"] - at[s + "ankle"] for s in "lr"]).sum(0)
    if torch.nn.functional.cosine_similarity(feet, front, dim=-1).median() < -0.3:
        doubts.append("toes point backward: left and right may be exchanged, or it is mirrored")
