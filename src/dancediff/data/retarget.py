r"""Put recorded motion onto the SMPL-24 tree.

Read first: `dancediff.data.bvh` and `dancediff.motion.skeleton`.

Skeletons differ in where their joints sit, how long their bones are and what "not turned" means;
what they share is where limbs point. So bone directions in the world are kept, lengths are not.

Symbols (axes: f frames · j joints of SMPL-24)
    Q      rotations in the world                     (f, j, 3, 3)
    turn   rotations of the source since its rest     (f, 3, 3) for each joint it has
    face   SMPL axes (x left, y up, z front) at rest  (3, 3)    as columns, in the source's world
    s      SMPL leg length / source leg length
"""

from dataclasses import dataclass, replace

import torch
from torch import Tensor

from dancediff.axes import FPS, ON_FLOOR
from dancediff.data.bvh import BVH
from dancediff.data.joint_maps import GIRDLES, bones, find_joints
from dancediff.data.repair import bridge, close_gaps, repair, runs
from dancediff.data.resample import moments
from dancediff.motion.contact import CONTACT_HEIGHT, TOE_CLEARANCE, foot_contact
from dancediff.motion.ik import frame_from_bone, two_bone_ik
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix, rotation_between, slerp
from dancediff.motion.skeleton import FOOT_JOINTS, SMPL24, forward_kinematics

TOE_FLOOR = 0.01  # metres: no toe is put lower
ANKLE_FLOOR = 0.05  # metres: no ankle is put lower
KNEE_FRONT = 0.05  # leg lengths: how much a straight leg's thigh decides where its knee points
KNEE_REACH = 1.8  # radians from pointing to the front and outward
STIFF = ("ltoe", "rtoe", "lhand", "rhand")  # move with foot and wrist
STANDING = 0.005  # metres a frame at 30 fps
SKATE_SPEED = 0.01  # metres a frame


@dataclass(frozen=True)
class _Source:
    """What is read from a recording: SMPL-24 name -> points, rotations, rest points."""

    points: dict[str, Tensor]  # (f, 3)
    turn: dict[str, Tensor]  # (f, 3, 3)
    rest: dict[str, Tensor]  # (3,)
    face: Tensor


def retarget(
    bvh: BVH, joints: str | dict[str, str] = "generic", *, scale: float | None = None, suspect=()
) -> tuple[Motion, dict]:
    r"""Turn a recording into a `Motion` of one dancer at 30 fps, with what was measured on the way.

    1. Spikes and flips are repaired (`repair`; ``suspect`` is passed on).
    2. Rotations are brought to 30 fps by slerp, paths linearly.
    3. Every mapped bone points where it points in the source: $Q_j = \text{turn}_j\,A_j$, where the
       constant $A_j$ carries SMPL's rest bone onto the source's. Pelvis, head and collar bones are
       turned as in the source but not aligned: where those begin is a habit of each skeleton.
    4. The hips' middle is ``scale`` times the source's; so are the ankles, by two-bone IK, since
       hip widths differ and feet would slide otherwise. Knees bend to where the source's bend; a
       knee on the wrong side of its leg is turned back. ``scale`` is s unless given.
    5. The floor is found from the standing toes (`floor_height`) and brought to y = 0; a toe that
       would be under it is lifted by tilting the foot.
    6. Contacts are labelled anew.

    ``joints`` names a map ("cmu", "mixamo", "generic") or is one (SMPL-24 name -> name in file).
    The source is y up.

    Returns the motion and plain numbers: see `measure`, and "repairs" (in frames of ``bvh``),
    "scale", "floor" (metres).

    Raises: ValueError naming the joints that are missing, or a scale that is not positive.
    """
    names = find_joints(bvh.names, joints)
    bvh, repairs = repair(bvh, names, suspect=suspect)
    source = _source(resample(bvh, FPS), names)
    s = leg_scale(bvh, names) if scale is None else float(scale)
    if not 0 < s < torch.inf:
        raise ValueError(f"scale={scale} must be a positive number")
    root, pose, _ = _place(source, s)
    floor = floor_height(forward_kinematics(pose, root)[:, FOOT_JOINTS])
    root, pose, wrong = _place(source, s, ground=floor)
    back = bvh.fps / FPS
    for knee, stretches in wrong.items():
        about = {"joint": names[knee], "kind": "knee"}
        repairs += [
            about | {"first": round(a * back), "last": round(b * back)} for a, b in stretches
        ]
    motion = Motion(pose[None], (root - root.new_tensor([0.0, floor, 0.0]))[None], FPS)
    motion = replace(motion, contact=foot_contact(motion.joints()))
    measured = measure(motion, {k: s * p for k, p in source.points.items()})
    return motion, {**measured, "repairs": repairs, "scale": s, "floor": floor}


def resample(bvh: BVH, fps: float) -> BVH:
    """Bring a recording to another frame rate: slerp between rotations, lines between points.

    Nothing is filtered first; a recording at twice the rate loses every other frame.
    """
    before, after, w = moments(bvh.num_frames, bvh.fps, fps)
    rotations, move = bvh.rotations[before], bvh.translations[before]
    if w.any():
        between = w[:, None].expand(rotations.shape[:2])
        rotations = slerp(rotations, bvh.rotations[after], between)
        move = torch.lerp(move, bvh.translations[after], w[:, None, None])
    return replace(bvh, rotations=rotations, translations=move, fps=fps)


def leg_scale(bvh: BVH, joints: dict[str, str]) -> float:
    """SMPL's leg length over the recording's: thigh and shin, both sides.

    Raises: ValueError when the recording's legs have no length.
    """
    rest, smpl = bvh.rest(), _smpl_rest()
    ours = theirs = 0.0
    for side in "lr":
        for a, b in ((f"{side}hip", f"{side}knee"), (f"{side}knee", f"{side}ankle")):
            ours += (smpl[b] - smpl[a]).norm().item()
            theirs += (rest[bvh.index(joints[b])] - rest[bvh.index(joints[a])]).norm().item()
    if theirs < 1e-6:
        raise ValueError("the legs of the BVH have no length; its OFFSETs are zero")
    return ours / theirs


def floor_height(feet: Tensor, fps: float = FPS) -> float:
    r"""Height of the floor under a take: the median height of the lower toe while it stands.

    Standing is slower than `STANDING`. The lowest toes of all would follow the frames in which a
    recording sinks, or a dancer lies on the floor with the feet anywhere.

    Shapes: feet (f, 4, 3) metres, y up: left and right ankle, left and right toe.
    """
    toes = feet[:, 2:]
    speed = toes.diff(dim=0).norm(dim=-1)
    height, low = toes[:-1, :, 1].min(dim=-1)
    stands = speed.gather(1, low[:, None])[:, 0] < STANDING * (FPS / fps)
    height = height[stands] if stands.any() else toes[:, :, 1].flatten()
    return height.median().item() - TOE_CLEARANCE


def skating_ratio(feet: Tensor) -> float:
    r"""Share of the frames with a foot down in which that foot slides.

    Down: ankle and toe are under `CONTACT_HEIGHT`, 12 cm and 5 cm. Slides: ankle or toe moves
    more than 1 cm a frame in the floor plane. 0 when no foot is ever down.

    Source: Lodge's foot-skating ratio.  Differs: speed is the length of the horizontal step, where
    Lodge's code takes the mean of its two signed parts, in which opposite signs cancel.

    Shapes: feet (f, 4, 3) metres above the floor: left and right ankle, left and right toe.
    """
    step = feet[1:, ..., ON_FLOOR] - feet[:-1, ..., ON_FLOOR]
    slides = (step.norm(dim=-1) > SKATE_SPEED).unflatten(-1, (2, 2)).any(-2)
    down = (feet[:-1, :, 1] < feet.new_tensor(CONTACT_HEIGHT)).unflatten(-1, (2, 2)).all(-2)
    return (slides & down).sum().item() / max(down.sum().item(), 1)


def measure(motion: Motion, points: dict[str, Tensor]) -> dict:
    r"""How well a motion of one dancer follows the source's joints (metres, at the motion's rate).

    direction_error: mean angle in degrees over frames and mapped bones (and each bone's own mean);
    skating_source, skating: `skating_ratio`, the source above its own floor; penetration_p95: 95th
    percentile over frames of how deep the lowest joint is under the floor; lowest_median: its
    median height, metres.
    """
    ours = motion.joints()[0].double()
    feet = ("lankle", "rankle", "ltoe", "rtoe")
    errors = {}
    for a, b in bones(points):
        d = ours[:, SMPL24.index(b)] - ours[:, SMPL24.index(a)]
        error = torch.nn.functional.cosine_similarity(d, points[b] - points[a], dim=-1)
        errors[f"{a}-{b}"] = round(error.clamp(-1, 1).acos().rad2deg().mean().item(), 3)
    lowest = ours[..., 1].min(dim=-1).values
    numbers = {
        "direction_error": sum(errors.values()) / len(errors),
        "bone_errors": errors,
        "skating": skating_ratio(ours[:, FOOT_JOINTS]),
        "penetration_p95": (-lowest).clamp_min(0).quantile(0.95).item(),
        "lowest_median": lowest.median().item(),
    }
    if all(name in points for name in feet):
        theirs = torch.stack([points[name] for name in feet], 1)
        theirs[..., 1] -= floor_height(theirs)
        numbers["skating_source"] = skating_ratio(theirs)
    return numbers


def _source(bvh: BVH, names: dict[str, str]) -> _Source:
    """The mapped joints of a recording."""
    points, Q = bvh.world()
    at = {ours: bvh.index(name) for ours, name in names.items()}
    rest = {ours: bvh.rest()[j] for ours, j in at.items()}
    return _Source(
        points={ours: points[:, j] for ours, j in at.items()},
        turn={ours: Q[:, j] for ours, j in at.items()},
        rest=rest,
        face=_body_frame(rest) @ _body_frame(_smpl_rest()).mT,
    )


def _smpl_rest() -> dict[str, Tensor]:
    eye = torch.eye(3, dtype=torch.float64).expand(SMPL24.num_joints, 3, 3)
    joints = forward_kinematics(eye, torch.zeros(3, dtype=torch.float64))
    return dict(zip(SMPL24.names, joints, strict=True))


def _body_frame(rest: dict[str, Tensor]) -> Tensor:
    """Left, up and front of a body at rest, as columns."""
    left = rest["lshoulder"] - rest["rshoulder"]
    up = rest["neck"] - (rest["lhip"] + rest["rhip"]) / 2
    if torch.linalg.cross(left, up).norm() < 1e-9:
        raise ValueError("the rest pose of the BVH has no shoulders beside its neck; map others")
    return frame_from_bone(left, up)


def _rotations(source: _Source) -> list[Tensor]:
    """World rotation of each SMPL-24 joint, (f, 3, 3) each; legs before their IK."""
    smpl = _smpl_rest()
    aligned = {}
    for a, b in bones(source.rest):
        bone = source.rest[b] - source.rest[a]
        if bone.norm() > 1e-6 and (a, b) not in GIRDLES:
            between = rotation_between(source.face @ (smpl[b] - smpl[a]), bone)
            aligned[a] = between @ source.face
    Q: list = []
    for name, parent in zip(SMPL24.names, SMPL24.parents, strict=True):
        if name in source.turn and name not in STIFF:
            Q.append(source.turn[name] @ aligned.get(name, source.face))
        else:  # not recorded: moves with its parent
            Q.append(Q[parent])
    return Q


def _place(source: _Source, s: float, ground: float = -torch.inf) -> tuple[Tensor, Tensor, dict]:
    """Root path (f, 3), rotations (f, 24, 3, 3), wrong knees; feet stay above ``ground``."""
    smpl, Q, at = _smpl_rest(), _rotations(source), SMPL24.index
    offset = SMPL24.offsets.double()
    middle = (smpl["lhip"] + smpl["rhip"]) / 2
    hips = (source.points["lhip"] + source.points["rhip"]) / 2
    root = s * hips - Q[0] @ middle
    wrong: dict[str, list] = {}
    for side in "lr":
        hip, knee, ankle, toe = (at(side + part) for part in ("hip", "knee", "ankle", "toe"))
        target = s * source.points[f"{side}ankle"]
        target[:, 1] = target[:, 1].clamp_min(ground + ANKLE_FLOOR)
        start = root + Q[0] @ offset[hip]
        pole, back, wrong[f"{side}knee"] = _knee_pole(source, side, Q[hip], Q[0])
        Q[hip], Q[knee], reached = two_bone_ik(start, target, pole, offset[knee], offset[ankle])
        Q[ankle] = _lift_toe(back @ Q[ankle], reached, offset[toe], ground + TOE_FLOOR)
        Q[toe] = Q[ankle]
    local = [q if p < 0 else Q[p].mT @ q for q, p in zip(Q, SMPL24.parents, strict=True)]
    return root, torch.stack(local, 1), wrong


def _knee_pole(source: _Source, side: str, thigh: Tensor, pelvis: Tensor) -> tuple:
    r"""Where the knee points (f, 3), how the leg was turned for it (f, 3, 3), wrong stretches.

    The angle phi of the knee around the line from hip to ankle is taken from a reference that moves
    with that line: front and outward for a hanging leg. No hip lets the knee further from it than
    `KNEE_REACH`; recordings of deep squats do. There phi is bridged, and the ankle stays.
    """
    hip, knee, ankle = (source.points[side + part] for part in ("hip", "knee", "ankle"))
    line = torch.nn.functional.normalize(ankle - hip, dim=-1)
    # a straight leg has no knee to go by: there the front of the thigh decides
    length = (ankle - knee).norm(dim=-1, keepdim=True) + (knee - hip).norm(dim=-1, keepdim=True)
    pole = (knee - hip) / length + KNEE_FRONT * thigh[..., 2]
    outward = 1.0 if side == "l" else -1.0
    local = (pelvis.mT @ line[..., None])[..., 0]
    tilt = rotation_between(local.new_tensor([0.0, -1.0, 0.0]).expand_as(local), local)
    front = (pelvis @ tilt @ local.new_tensor([outward, 0.0, 1.0])) / 2**0.5
    across = torch.linalg.cross(line, front)
    phi = torch.atan2((pole * across).sum(-1), (pole * front).sum(-1))
    bad = close_gaps(phi.abs()[:, None] > KNEE_REACH, FPS)[:, 0]
    good = bridge(phi, bad)
    back = axis_angle_to_matrix(line * (good - phi)[:, None])  # the foot hung on the wrong shin
    return good[:, None].cos() * front + good[:, None].sin() * across, back, runs(bad)


def _lift_toe(Q: Tensor, ankle: Tensor, toe: Tensor, ground: float) -> Tensor:
    """Tilt the foot so far that its toe is not under ``ground``; its heading stays."""
    foot = Q @ toe
    drop = (ground - ankle[:, 1]).clamp(-toe.norm(), toe.norm())
    height = torch.maximum(foot[:, 1], drop)
    flat = torch.nn.functional.normalize(foot * foot.new_tensor([1.0, 0, 1.0]), dim=-1)
    lifted = flat * (toe.norm() ** 2 - height**2).clamp_min(0).sqrt()[:, None]
    lifted[:, 1] = height
    return torch.where((height > foot[:, 1])[:, None, None], rotation_between(foot, lifted) @ Q, Q)
