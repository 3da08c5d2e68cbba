r"""How moves and genres are written down.

Read first: docs/choreographer.md.

A move lasts eight counts, one a beat. It is written as text, so that a genre reads like a list:

    feet   ``foot count x z [how] [^lift] [@yaw]``, separated by ``;``. ``R1 -.3 0`` puts the right
           foot 30 cm to the dancer's right on count 1, ``L2& 0 .2 tap`` the left one on the ball
           between counts 2 and 3. A text of counts 1-4 is danced again mirrored on 5-8, one of
           counts 1-2 four times.
    arms   names of poses (poses.py), spread over the eight counts; ``.`` holds or passes on; a name
           ending in ``*`` is reached on the beat but not stopped at
    body   ``channel value value ...``, spread over the counts; 16 values fill the off-beats too

Directions are the dancer's own: x to the left, y up, z to the front. How a foot lands: ``step``
and ``ball`` take weight, ``tap`` and ``heel`` do not, ``air:h`` stays h metres up, ``jump`` and
``leap`` come down from a flight of one and of two beats.
"""

import re
from dataclasses import dataclass, fields, replace
from functools import cache, cached_property

import numpy as np

COUNTS = 8
# what a torso does, in degrees; hip and level in centimetres
CHANNELS = (
    *("pitch", "bend", "twist", "rib", "pop"),  # forward, to the left, to the left; isolations
    *("roll", "tuck", "hip", "level"),  # pelvis: left side up, tail under, to the left, down
    *("look", "nod", "tilt", "shrug", "face"),  # head: left, down, left ear down; shoulders; facing
)
CHANNEL = {name: i for i, name in enumerate(CHANNELS)}
FLIPPED = ("bend", "twist", "rib", "roll", "hip", "look", "tilt", "face")
FLIP_SIGN = np.array([-1.0 if name in FLIPPED else 1.0 for name in CHANNELS])
_FALL = re.compile(
    r"([LR])(\d)(&?) (\S+) (\S+)(?: (step|ball|tap|heel|air|jump|leap)(?::(\S+))?)?"
    r"(?: \^(\S+))?(?: @(\S+))?$"
)


@dataclass(frozen=True)
class Footfall:
    """One landing within a move; x and z are metres from where the foot stands at rest."""

    count: float  # 0 is the first count of the move
    foot: str
    x: float
    z: float
    how: str = "step"
    height: float = 0.0  # metres above the floor, for "air"
    lift: float | None = None  # metres the foot rises on its way
    yaw: float = 0.0  # degrees, toes to the left

    def mirrored(self) -> "Footfall":
        """The same for the other foot."""
        other = "R" if self.foot == "L" else "L"
        return replace(self, foot=other, x=-self.x, yaw=-self.yaw)

    def later(self, counts: float) -> "Footfall":
        """The same, some counts later."""
        return replace(self, count=self.count + counts)


def parse_feet(text: str) -> tuple[Footfall, ...]:
    """Read footfalls; see the module's text.

    Raises: ValueError quoting the footfall that cannot be read.

    >>> [(fall.foot, fall.count, fall.x) for fall in parse_feet("R1 -.3 0; L3& -.2 0")]
    [('R', 0.0, -0.3), ('L', 2.5, -0.2), ('L', 4.0, 0.3), ('R', 6.5, 0.2)]
    """
    falls = []
    for part in filter(None, (p.strip() for p in text.split(";"))):
        found = _FALL.match(part)
        if not found:
            raise ValueError(
                f"footfall {part!r} is not of the form 'R1 -.3 0 [how] [^lift] [@yaw]'"
            )
        foot, count, half, x, z, how, height, lift, yaw = found.groups()
        falls.append(
            Footfall(
                int(count) - 1 + (0.5 if half else 0.0), foot, float(x), float(z), how or "step",
                float(height or 0), None if lift is None else float(lift), float(yaw or 0),
            )
        )  # fmt: skip
    last = max((fall.count for fall in falls), default=7)
    if last < 2:  # two counts, four times
        falls = [fall.later(2 * k) for k in range(4) for fall in falls]
    elif last < 4:
        falls += [fall.mirrored().later(4) for fall in falls]
    return tuple(sorted(falls, key=lambda fall: fall.count))


def parse_body(text: str) -> tuple[np.ndarray, np.ndarray]:
    """Read channels: values on the counts (8, c), and what the off-beats add to the way (8, c).

    Raises: ValueError naming an unknown channel or a number of values that does not fill a phrase.

    >>> on, off = parse_body("twist 20 -20; level 0 4 8 4 0 4 8 4")
    >>> on[:3, CHANNEL["twist"]].tolist(), on[:3, CHANNEL["level"]].tolist()
    ([20.0, -20.0, 20.0], [0.0, 4.0, 8.0])
    """
    on, off = np.zeros((2, COUNTS, len(CHANNELS)))
    for part in filter(None, (p.strip() for p in text.split(";"))):
        name, *numbers = part.split()
        if name not in CHANNEL:
            raise ValueError(f"channel {name!r} is unknown; known: {', '.join(CHANNELS)}")
        if len(numbers) not in (1, 2, 4, 8, 16):
            raise ValueError(f"{part!r} has {len(numbers)} values; give 1, 2, 4, 8 or 16")
        values = np.array(numbers, dtype=np.float64)
        place = CHANNEL[name]
        if len(values) == 16:
            on[:, place] = values[::2]
            off[:, place] = values[1::2] - (values[::2] + np.roll(values[::2], -1)) / 2
        else:
            on[:, place] = np.tile(values, COUNTS // len(values))
    return on, off


def parse_arms(text: str) -> tuple[tuple[float, str, bool], ...]:
    """Read poses: (count, name, is it only passed through); dots are left out.

    Raises: ValueError when the poses do not fill a phrase.

    >>> parse_arms("low . high* .")[:2]
    ((0.0, 'low', False), (2.0, 'high', True))
    """
    names = text.split()
    if len(names) not in (1, 2, 4, 8, 16):
        raise ValueError(f"arms {text!r} are {len(names)} poses; give 1, 2, 4, 8 or 16")
    step = 0.5 if len(names) == 16 else 1.0
    names = names * max(1, COUNTS // len(names))
    return tuple(
        (k * step, name.rstrip("*"), name.endswith("*"))
        for k, name in enumerate(names)
        if name != "."
    )


@dataclass(frozen=True)
class Move:
    """Eight counts. ``energy`` 1 (verse) to 3 (chorus); ``whole`` keeps its arms to itself."""

    name: str
    feet: str
    left: str
    right: str | None = None
    body: str = ""
    energy: int = 2
    whole: bool = False

    @cached_property
    def falls(self) -> tuple[Footfall, ...]:
        """Footfalls in time order."""
        return parse_feet(self.feet)

    @cached_property
    def landings(self) -> tuple[list[tuple[Footfall, ...]], ...]:
        """Footfalls of each count, with the time since it: of the move, and of its mirror image."""
        of_counts = [
            [fall.later(-k) for fall in self.falls if int(fall.count) == k] for k in range(COUNTS)
        ]
        mirrored = [tuple(fall.mirrored() for fall in falls) for falls in of_counts]
        return [tuple(falls) for falls in of_counts], mirrored

    @cached_property
    def channels(self) -> tuple[np.ndarray, np.ndarray]:
        """Torso on the counts and between them, (8, c) each."""
        return parse_body(self.body)

    @cached_property
    def arms(self) -> tuple[tuple, tuple]:
        """Pose keys of the left and of the right arm."""
        return parse_arms(self.left), parse_arms(self.right or self.left)


class MoveInThree(Move):
    """A move danced in two bars of three: its counts 1 to 3, and 5 to 7.

    Steps that alternate every count begin the second bar with the other foot: it is mirrored.
    """

    @cached_property
    def falls(self) -> tuple[Footfall, ...]:
        """Footfalls in time order."""
        bars = self._bars
        second = [fall.mirrored() for fall in bars[0]] if self._mirrored else bars[1]
        return (*bars[0], *(fall.later(3) for fall in second))

    @cached_property
    def channels(self) -> tuple[np.ndarray, np.ndarray]:
        """Torso on the counts and between them, (6, c) each."""
        sign = FLIP_SIGN if self._mirrored else 1.0
        on, off = (np.concatenate([x[:3], x[4:7] * sign]) for x in parse_body(self.body))
        return on, off

    @cached_property
    def arms(self) -> tuple[tuple, tuple]:
        """Pose keys of the left and of the right arm."""
        arms = parse_arms(self.left), parse_arms(self.right or self.left)
        second = arms[::-1] if self._mirrored else arms
        left, right = (
            tuple(key for key in one if key[0] < 3)
            + tuple((at - 1, name, through) for at, name, through in two if 4 <= at < 7)
            for one, two in zip(arms, second, strict=True)
        )
        return left, right

    @cached_property
    def _bars(self) -> tuple[tuple[Footfall, ...], ...]:
        """Footfalls of both bars, counted from the beginning of each."""
        falls = parse_feet(self.feet)
        return tuple(
            tuple(fall.later(-at) for fall in falls if at <= fall.count < at + 3) for at in (0, 4)
        )

    @property
    def _mirrored(self) -> bool:
        return bool(self.feet) and self._bars[0] == self._bars[1]


@dataclass(frozen=True)
class Groove:
    """How a genre sits in the beat."""

    height: float = 0.915  # metres, pelvis when standing
    bounce: float = 0.04  # metres down on every beat
    offbeat: float = 0.0  # metres down between the beats
    rock: float = 4.0  # degrees the chest folds with the bounce
    sway: float = 4.0  # degrees the chest leans away from the hip that carries the weight
    hip: float = 4.0  # degrees the pelvis tilts up over the standing leg
    hip_twist: float = 4.0  # degrees it turns to the standing leg
    shift: float = 0.75  # share of the weight that goes over the standing foot


@dataclass(frozen=True)
class Style:
    """How a genre goes from one pose to the next."""

    attack: float = 0.75  # beats a change takes; the rest of the time is held
    snap: float = 0.0  # 0 starts and stops softly, 1 starts at full speed
    flow: float = 0.0  # 1 does not slow down on the way from pose to pose
    lag: float = 0.06  # beats by which the elbow follows the shoulder, the hand the elbow
    smooth: float = 1.0  # frames of smoothing
    toe_out: float = 8.0  # degrees
    stance: float = 0.105  # metres from the middle to each foot
    lift: float = 0.08  # metres a stepping foot rises
    point: float = 0.35  # radians a lifted foot is stretched


@dataclass(frozen=True)
class Genre:
    """A dance genre: its moves, its travelling moves, its groove, style, tempo and energy."""

    name: str
    tempo: tuple[float, float]  # beats a minute that suit it
    energy: float  # 1 is average; scales bounce and torso
    groove: Groove
    style: Style
    moves: tuple[Move, ...]
    travel: tuple[Move, ...]
    rest: Move  # what those do who wait

    @property
    def phrase(self) -> int:
        """Counts of its moves: 8, in bars of three 6."""
        return len(self.rest.channels[0])


@cache
def in_three(genre: Genre) -> Genre:
    """The same genre for music in bars of three; its moves last six counts.

    Moves that would turn by more than a third of a circle on one count are left out.
    """

    def danced(moves) -> tuple[Move, ...]:
        return tuple(
            MoveInThree(**{field.name: getattr(move, field.name) for field in fields(move)})
            for move in moves
        )

    moves = [
        move
        for move in danced(genre.moves)
        if np.abs(np.diff(move.channels[0][:, CHANNEL["face"]])).max() <= 120
    ]
    (rest,) = danced([genre.rest])
    return replace(genre, moves=tuple(moves), travel=danced(genre.travel), rest=rest)
