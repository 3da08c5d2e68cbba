r"""The moves: key poses of arms and torso on the beats, and footsteps.

A move lasts eight beats. Directions are in the dancer's own frame: x to the dancer's left, y up,
z to the front. Arm poses give the direction of upper arm and forearm of the LEFT arm; the right
arm takes their mirror image.
"""

from dataclasses import dataclass

# name: (upper arm, forearm)
ARM_POSES = {
    "down": ((0.28, -1.0, 0.05), (0.12, -1.0, 0.30)),
    "low": ((0.75, -0.75, 0.10), (0.70, -0.70, 0.30)),
    "out": ((1.0, -0.05, 0.10), (1.0, 0.05, 0.25)),
    "high": ((0.65, 0.75, 0.10), (0.50, 0.90, 0.15)),
    "up": ((0.35, 1.0, 0.05), (0.05, 1.0, 0.10)),
    "front": ((0.25, -0.15, 1.0), (0.05, 0.05, 1.0)),
    "bent": ((0.35, -1.0, -0.15), (0.05, 0.15, 1.0)),
    "hip": ((0.75, -0.75, -0.25), (-0.75, -0.55, 0.35)),
    "goal": ((1.0, -0.05, 0.10), (0.15, 1.0, 0.15)),
    "fold": ((0.35, -0.55, 0.75), (-0.95, 0.15, 0.35)),
    "chest": ((0.95, -0.25, 0.25), (-0.75, 0.05, 0.70)),
    "brow": ((0.85, 0.40, 0.25), (-0.55, 0.75, 0.30)),
    "back": ((0.40, -0.90, -0.55), (0.25, -0.85, -0.25)),
}

# foot, dx, dz: where the foot lands on that beat, metres from its home; None = no step.
# The dancer's right is -x.
_ = None
FOOTWORK = {
    "bounce": [_, _, _, _, _, _, _, _],
    "march": [("R", 0, 0), ("L", 0, 0)] * 4,
    "step touch": [("R", -0.32, 0), ("L", -0.28, 0), ("L", 0.04, 0), ("R", 0, 0)] * 2,
    "double step": [
        *[("R", -0.30, 0), ("L", -0.28, 0), ("R", -0.56, 0), ("L", -0.54, 0)],
        *[("L", -0.26, 0), ("R", -0.28, 0), ("L", 0, 0), ("R", 0, 0)],
    ],
    "grapevine": [
        *[("R", -0.30, 0), ("L", -0.40, -0.16), ("R", -0.54, 0), ("L", -0.54, 0)],
        *[("L", -0.26, 0), ("R", -0.14, -0.16), ("L", 0, 0), ("R", 0, 0)],
    ],
    "V step": [("R", -0.14, 0.28), ("L", 0.14, 0.28), ("R", 0, 0), ("L", 0, 0)] * 2,
    "rock": [("R", 0, 0.28), _, ("R", 0, 0), _, ("L", 0, 0.28), _, ("L", 0, 0), _],
    "side rock": [("L", 0.30, 0), _, ("L", 0, 0), _, ("R", -0.30, 0), _, ("R", 0, 0), _],
    "wide": [("L", 0.16, 0), _, _, _, _, _, ("L", 0, 0), _],
    "box": [
        *[("R", -0.26, 0), ("L", -0.26, 0), ("R", -0.26, 0.26), ("L", -0.26, 0.26)],
        *[("L", 0, 0.26), ("R", 0, 0.26), ("L", 0, 0), ("R", 0, 0)],
    ],
}
LIFT = {"march": 0.17, "rock": 0.10}  # metres a swinging foot rises; others 0.09


@dataclass(frozen=True)
class Move:
    """Eight beats: footwork, one arm pose per side and one torso pose (degrees) on every beat."""

    name: str
    feet: str
    left: tuple[str, ...]
    right: tuple[str, ...]
    torso: tuple[tuple[float, float, float], ...]  # pitch (forward), bend (to the left), twist


def _move(name, feet, left, right=None, torso=((0, 0, 0),)) -> Move:
    left = tuple(left.split())
    right = left if right is None else tuple(right.split())
    full = [part * (8 // len(part)) for part in (left, right, tuple(torso))]
    return Move(name, feet, *full)


_SIDES = ((4, 9, 0), (4, -9, 0))
_TWIST = ((6, 0, 22), (6, 0, -22))
_NOD = ((10, 0, 0), (-4, 0, 0))

MOVES = [
    _move("groove", "bounce", "bent hip", "hip bent", _TWIST),
    _move("step touch clap", "step touch", "low front", None, _SIDES),
    _move("side reach", "double step", "down out high out", "hip hip chest hip", _SIDES),
    _move("vine and roll", "grapevine", "chest out chest up", None, ((4, 5, 12), (4, -5, -12))),
    _move("V raise", "V step", "low goal high hip", None, _NOD),
    _move("rock and pull", "rock", "front bent front back", "back bent back front", _TWIST),
    _move("pendulum", "side rock", "out fold out fold", "hip fold hip fold", _SIDES),
    _move("march pump", "march", "bent goal", "goal bent", ((5, 0, 14), (5, 0, -14))),
    _move("waves", "wide", "out high out low", "low out high out", ((3, 12, 0), (3, -12, 0))),
    _move("box frame", "box", "fold goal fold out", None, _NOD),
    _move("hero", "wide", "hip hip up up", "up up hip hip", ((0, 8, 10), (0, 8, 10))),
    _move("brow salute", "step touch", "brow low hip low", "hip low brow low", _SIDES),
]
TRAVEL = _move("travel", "march", "bent low", "low bent", ((5, 0, 12), (5, 0, -12)))
