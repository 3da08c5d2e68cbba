r"""What a band plays in one kind of section: drum grids, chords, bass and a riff, in any meter.

Symbols (axes: s steps of a bar, meter times division)
    kick, snare, hat, shaker   how hard each step is hit, 0: not   (s,)
    bass                       is a note begun                      (s,)
    lead                       degree above the chord, -1: none     (s,)
"""

import numpy as np

from dancediff.music.band import PROGRESSIONS
from dancediff.music.song_plan import SongPlan

_WEIGHT = {  # beats of kick and snare in a bar of 4, 3 and 2 beats
    4: ((0, 2), (1, 3)),
    3: ((0,), (1, 2)),
    2: ((0,), (1,)),
}


def write_groove(plan: SongPlan, label: str, feel: str, rng: np.random.Generator) -> dict:
    """Draw the material of a section; every beat is hit by the drums, and by the bass or not.

    "half": the snare comes half as often, and later; "double": twice as often, between the beats.

    >>> from dancediff.music.song_plan import draw_plan
    >>> groove = write_groove(draw_plan(4), "chorus", "straight", np.random.default_rng(0))
    >>> groove["snare"][[4, 12]].tolist(), groove["kick"][:1].tolist()
    ([1.0, 1.0], [1.0])
    """
    meter, division = plan.meter, plan.division
    steps, full = meter * division, label in ("chorus", "build")
    kicks, snares = _WEIGHT[meter]
    if feel == "half":
        snares = (meter - 1,) if meter != 4 else (2,)
    kick, snare, hat = np.zeros(steps), np.zeros(steps), np.zeros(steps)
    every = (full and rng.random() < 0.6) or label == "build"
    kick[np.arange(0, steps, division) if every else np.multiply(kicks, division)] = 1
    kick = np.maximum(kick, 0.7 * (rng.random(steps) < (0.1 if full else 0.05)))
    snare[np.multiply(snares, division)] = 1
    if feel == "double":
        snare = np.zeros(steps)
        snare[np.arange(0, steps, division) + division // 2] = 0.8
    hat[:: 1 if division == 3 else int(rng.choice([1, 2, 2, 4]))] = 0.6
    hat[::division] = 1
    return {
        "kick": kick,
        "snare": snare * (0.5 if label in ("intro", "bridge") else 1),
        "hat": hat,
        "shaker": (rng.random(steps) < 0.5) * 0.6,
        "chords": PROGRESSIONS[rng.integers(len(PROGRESSIONS))],
        "bass": (rng.random(steps) < 0.35) | (np.arange(steps) == 0),
        "lead": np.where(rng.random(steps) < 0.3, rng.integers(0, 8, steps), -1),
    }
