r"""From the score to landings, jumps and facing: where the feet of one dancer really go.

Read first: `dancediff.data.choreographer.score` and `dancediff.data.choreographer.footsteps`.

Symbols (axes: k beats)
    centre   the dancer's place on every beat, metres         (k, 2)
    facing   where the dancer faces on every beat, degrees    (k,)
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from math import cos, sin

import numpy as np

from dancediff.data.choreographer.breath import HOLD
from dancediff.data.choreographer.footsteps import PIVOT, TOES, Jump, Step
from dancediff.data.choreographer.moves import CHANNEL, FLIP_SIGN, Footfall, Style
from dancediff.data.choreographer.score import Count, Score

AWAY = 0.05  # metres from its place at which a foot is brought home
CLEAR = 0.16  # metres between the middles of a passing foot and of the standing one
BESIDE, BEHIND = 0.13, 0.23  # metres between two standing feet: side by side, or one in front
NEAR = 0.7  # metres; a foot that steps further travels
STRIDE = 0.12  # metres by which one foot may be in front of the other in a turn
_OTHER = {"L": "R", "R": "L"}
_SOLE = {foot: toes[[0, 2]] for foot, toes in TOES.items()}
SINK = 0.27  # beats between the landing of a jump and the beat
FLIGHT = {"jump": (0.46, 0.42), "leap": (1.0, 0.56)}  # beats of flight, and seconds at most


@dataclass(frozen=True)
class Walk:
    """Plan of one dancer's feet and body, on the beat grid."""

    steps: dict[str, list[Step]]
    jumps: list[Jump]
    on: np.ndarray  # channels on the counts (k, c), "face" in degrees and unwrapped
    off: np.ndarray  # what they add between the counts (k, c)


def channels(score: Score, dancer: int) -> tuple[np.ndarray, np.ndarray]:
    """Torso channels of one dancer on every beat and between beats, (k, c) each."""
    rows: list[np.ndarray] = []
    others: list[np.ndarray] = []
    base = last = 0.0
    before = None
    for count in score.counts[dancer]:
        if count.move is HOLD and rows:
            rows.append(rows[-1])
            others.append(np.zeros_like(rows[-1]))
            continue
        if not _follows(before, count):  # a new move begins facing front, the shorter way round
            base = 360.0 * round(last / 360)
        a, b = count.move.channels
        sign = FLIP_SIGN if count.flip else 1.0
        row = a[count.within] * sign * count.size
        face = a[count.within, CHANNEL["face"]] * (-1 if count.flip else 1)
        last = row[CHANNEL["face"]] = base + face
        row[CHANNEL["level"]] += count.low
        rows.append(row)
        others.append(b[count.within] * sign * count.size)
        before = count
    on, off = np.array(rows), np.array(others)
    travel = travel_facing(score.centre[dancer])
    on[:, CHANNEL["face"]] += travel
    on[:, CHANNEL["look"]] += 0.6 * travel  # who travels looks ahead
    return on, off


def travel_facing(centre: np.ndarray) -> np.ndarray:
    """Degrees by which a travelling dancer turns to where the way leads, (k,)."""
    way = np.gradient(centre, axis=0) if len(centre) > 1 else np.zeros_like(centre)
    speed = np.linalg.norm(way, axis=-1)
    angle = np.degrees(np.arctan2(way[:, 0], way[:, 1]))
    angle = np.where(np.abs(angle) > 120, 0, np.clip(angle, -60, 60))  # backwards: face front
    return angle * np.clip((speed - 0.06) / 0.12, 0, 1)


def plan_walk(score: Score, dancer: int, style: Style, pace: np.ndarray, reach: float) -> Walk:
    """All landings of one dancer.

    ``pace`` are the seconds that each beat lasts (k,); ``reach`` scales steps from the place.
    """
    on, off = channels(score, dancer)
    counts = score.counts[dancer]
    place = _Places(score.centre[dancer], on[:, CHANNEL["face"]], style, reach)
    steps = {foot: [place.home(-1.0, foot)] for foot in "LR"}
    jumps: list[Jump] = []
    before = None
    for k, count in enumerate(counts):
        falls = _falls(count) if k > 0 else ()
        if k > 0 and count.move is not HOLD and not _follows(before, count):
            _come_home(steps, place, k, counts[k : k + 3])
        for fall in falls:
            beat = k + fall.count
            if fall.how in FLIGHT:
                jump = _flight(fall.how, beat, float(pace[k]))
                if not jumps or jump.start > jumps[-1].stop + 0.2:
                    jumps.append(jump)
                beat = jumps[-1].stop
            step = place.step(beat, fall, count.stride)
            if fall.how not in FLIGHT and fall.how != "air":
                step = place.clear(step, steps[_OTHER[fall.foot]][-1], fall.foot)
            if steps[fall.foot][-1].beat < beat - 0.2:
                steps[fall.foot].append(step)
        before = count
    return Walk(_make_way(steps, place), jumps, on, off)


def _follows(before: Count | None, count: Count) -> bool:
    return (
        before is not None
        and count.move is before.move
        and count.within == before.within + 1
        and count.flip == before.flip
    )


def _falls(count: Count) -> tuple[Footfall, ...]:
    """Landings of this count, with the time since it."""
    return count.move.landings[count.flip][count.within]


def _flight(how: str, beat: float, spb: float) -> Jump:
    """A jump has landed and sunk on its beat; a leap hangs in the air on the beat before."""
    beats, seconds = FLIGHT[how]
    length = min(beats, seconds / spb)
    if how == "jump":
        return Jump(beat - SINK - length, beat - SINK, spb)
    return Jump(beat - 1 - length / 2, beat - 1 + length / 2, spb)


class _Places:
    """Where feet stand: the dancer's place, turned to where the dancer faces."""

    def __init__(self, centre, face, style: Style, reach: float):
        self.style, self.reach = style, reach
        # plain lists: these are asked for one number at a time, thousands of times
        self.x, self.z, self.face = (r.tolist() for r in (*centre.T, np.radians(face)))

    def at(self, beat: float, ahead: float = 0.5) -> tuple[np.ndarray, float]:
        """Place and facing; a walking foot lands half a beat ahead of the body."""
        place = np.array([_read(self.x, beat + ahead), _read(self.z, beat + ahead)])
        return place, self.facing(beat)

    def facing(self, beat: float) -> float:
        """Where the body faces when a foot lands, radians: it is a little ahead."""
        return _read(self.face, beat + 0.2)

    def step(self, beat: float, fall: Footfall, size: float = 1.0) -> Step:
        centre, face = self.at(beat)
        out = np.array([fall.x, fall.z]) * self.reach * size
        side = 1 if fall.foot == "L" else -1
        home = _turned(np.array([side * self.style.stance, 0.0]), face)
        if fall.how == "air":  # gestures turn with the body, steps stay on the stage's axes
            out = _turned(np.array([fall.x, fall.z]) * size, face)
        return Step(
            beat, centre + home + out, fall.how, fall.height * size,
            self.style.lift if fall.lift is None else fall.lift, max(0.0, -0.1 - fall.z),
            np.radians(side * self.style.toe_out + fall.yaw),
        )  # fmt: skip

    def clear(self, step: Step, other: Step, foot: str) -> Step:
        """Moved aside, forwards or backwards as little as needed not to tread on the other foot."""
        if other.height > 0:
            return step
        face = self.facing(step.beat)
        side = 1.0 if foot == "L" else -1.0
        stands, _ = self.stands(step.beat, other, _OTHER[foot])
        x, z = _turned(step.place - stands, -face)  # as the dancer sees it
        aside, ahead = BESIDE - side * x, BEHIND - abs(z)
        turned = abs(face - self.facing(other.beat)) > PIVOT
        turning = turned and x * x + z * z < NEAR**2  # no time to cross feet
        if turning:
            shift = [side * max(aside, 0.0), np.clip(z, -STRIDE, STRIDE) - z]
        elif aside <= 0 or ahead <= 0:
            return step
        elif abs(z) > 0.08 and ahead < aside:
            shift = [0.0, ahead if z > 0 else -ahead]
        else:
            shift = [side * aside, 0.0]
        return replace(step, place=step.place + _turned(np.array(shift), face))

    def stands(self, beat: float, step: Step, foot: str) -> tuple[np.ndarray, np.ndarray]:
        """Ankle and middle of a foot at a later beat: in a turn it goes round on its ball."""
        sole = _SOLE[foot]
        landed, now = self.facing(step.beat), self.facing(max(beat, step.beat))
        heel = _turned(sole, landed + step.yaw)
        if abs(now - landed) <= PIVOT:
            return step.place, step.place + 0.5 * heel
        toes = step.place + heel
        heel = _turned(sole, now + step.yaw)
        return toes - heel, toes - 0.5 * heel

    def home(self, beat: float, foot: str) -> Step:
        return self.step(beat, Footfall(0, foot, 0.0, 0.0))


def _turned(v: np.ndarray, yaw: float) -> np.ndarray:
    x, z, c, s = float(v[0]), float(v[1]), cos(yaw), sin(yaw)
    return np.array([x * c + z * s, z * c - x * s])


def _read(row: list[float], at: float) -> float:
    """A value between those of a list, the ends carried on."""
    at = min(max(at, 0.0), len(row) - 1.0)
    k = min(int(at), len(row) - 2) if len(row) > 1 else 0
    after = row[k + 1] if len(row) > 1 else row[k]
    return row[k] + (at - k) * (after - row[k])


def _come_home(steps, place: _Places, k: int, ahead: list[Count]) -> None:
    """Bring back feet that a move cut short left behind, the free one first."""
    falls = [replace(f, count=f.count + i) for i, c in enumerate(ahead) for f in _falls(c)]
    order = sorted("LR", key=lambda foot: steps[foot][-1].how in ("step", "ball", "jump", "leap"))
    late = 0
    for foot in order:
        beat = float(k + late)
        last, home = steps[foot][-1], place.home(float(k + late), foot)
        free = last.how not in ("step", "ball", "jump", "leap")
        soon = min((f.count for f in falls if f.foot == foot), default=9.0) <= late + 0.6
        if soon or last.beat > beat - 0.3:
            continue
        if free or np.linalg.norm(last.place - home.place) > AWAY:
            steps[foot].append(home)
            late += 1


def _make_way(steps: dict[str, list[Step]], place: _Places) -> dict[str, list[Step]]:
    """Bow the way of a foot that would pass through the other one."""
    out = {}
    for foot, other in _OTHER.items():
        times = [s.beat for s in steps[other]]
        row = steps[foot][:1]
        for a, b in pairwise(steps[foot]):
            stands = steps[other][max(int(np.searchsorted(times, b.beat - 0.2)) - 1, 0)]
            _, start = place.stands(b.beat - 0.6, a, foot)
            _, stop = place.stands(b.beat, b, foot)
            _, middle = place.stands(b.beat - 0.3, stands, other)
            row.append(replace(b, bow=_bow(start, stop, middle)))
        out[foot] = row
    return out


def _bow(a: np.ndarray, b: np.ndarray, stands: np.ndarray) -> np.ndarray:
    way = b - a
    length = float(way @ way)
    if length < 1e-4:
        return np.zeros(2)
    nearest = a + way * np.clip((stands - a) @ way / length, 0, 1)
    aside = nearest - stands
    gap = float(np.sqrt(aside @ aside))
    if gap >= CLEAR:
        return np.zeros(2)
    square = np.array([-way[1], way[0]]) / np.sqrt(length)
    sign = 1.0 if aside @ square >= 0 else -1.0
    return square * sign * (CLEAR - gap)
