"""Popping and robot: sudden hits, then nothing moves; right angles."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

POPPING = Genre(
    name="popping",
    tempo=(88, 118),
    energy=0.95,
    groove=Groove(height=0.925, bounce=0.022, rock=5, sway=3, hip=2, hip_twist=2, shift=0.65),
    style=Style(
        attack=0.5, snap=0.6, lag=0.02, smooth=0.8, toe_out=9, stance=0.12, lift=0.05, point=0.1
    ),
    moves=(
        Move(
            "fresno", "R1 -.24 0; L2 -.05 0 tap; L3 .05 0; R4 0 0 tap",
            "scoop low bent low", "low scoop low bent",
            "twist 22 0 -22 0; pop 12 0; bend 6 0 -6 0; look 18 0 -18 0", energy=1,
        ),
        Move(
            "robot angles", "R1 -.10 0; R8 0 0",
            "bent bent tut-up . tut-front bent down bent",
            "down bent . tut-front . tut-up bent down",
            "twist 25 25 0 -25 -25 0 25 0; look 25 0 -25 -25 0 25 0 0; bend 0 8 0 -8 0 8 0 0",
            energy=1, whole=True,
        ),
        Move(
            "tutting", "R1 -.14 0; R8 0 0",
            "tut-up tut-in goal-down tut-front tut-up crown fold tut-in",
            "tut-in tut-up tut-front goal-down fold crown tut-up tut-in",
            "rib 6 -6; look 20 -20 15 -15 20 0 -20 0; level 2 2 6 6 2 2 8 4", energy=2,
        ),
        Move(
            "chest hits", "R1 -.16 0; L4 .08 0; R8 0 0",
            "lock . low . goal-down . bent low", None,
            "pop 18 -6; level 8 2 8 2 12 4 8 2; pitch 4 -2; nod 6 -4; shrug 5 0", energy=2,
        ),
        Move(
            "arm wave", "L1 .10 0; L8 0 0",
            "out wave-up wave-down out out side-low low low",
            "side-low low out wave-down wave-up out out low",
            "rib -10 -4 4 10 10 4 -4 -10; bend -6 -3 3 6 6 3 -3 -6; look 30 20 0 -20 -30 -20 0 20",
            energy=2, whole=True,
        ),
        Move(
            "walk-out", "R1 -.10 .22; L2 0 0 tap; L3 .10 .22; R4 .0 .2 tap; R5 -.2 0; L6 .1 0;"
            "R7 0 0; L8 0 0",
            "bent tut-front down . lock . bent down", "tut-front bent . down lock . down bent",
            "twist 18 0 -18 0 0 0 14 0; pop 10 0; level 2 2 2 2 14 10 4 2; pitch 2 2 2 2 14 6 2 2",
            energy=2,
        ),
        Move(
            "dime stops", "R1 -.12 0; R8 0 0",
            "front . across . out . raise goal-down", "goal-down . out . front . across low",
            "twist -20 -20 15 15 -20 -20 20 0; bend -6 0 6 0 -6 0 6 0; look -20 0 20 0 -20 0 20 0",
            energy=3,
        ),
        Move(
            "robot turn", "R1 0 0; L2 0 0; R3 0 0; L4 0 0; R5 -.14 0; R8 0 0",
            "bent . tut-front . goal-down . lock low", "tut-front . bent . goal-down . lock low",
            "face 0 90 180 270 360 360 360 360; level 2 2 2 2 12 6 10 2; pop 0 0 0 0 14 0 14 0",
            energy=3, whole=True,
        ),
        Move(
            "neck and knees", "R1 -.16 .05; L5 .06 .05; R8 0 0",
            "chin . hip . fold . low .", "hip . chin . fold . low .",
            "level 12 4 14 4 18 6 12 2; look 35 0 -35 0 0 25 -25 0; tilt 0 10 0 -10 0 8 0 0;"
            "pitch 8 0 8 0 14 4 6 0", energy=3,
        ),
    ),
    travel=(
        Move(
            "robot walk", "R1 0 0; L2 0 0", "bent down", "down bent", "twist 16 -16; pop 8 0",
        ),
        Move(
            "strobe walk", "R1 0 0; L2 0 0", "tut-front low", "low tut-front",
            "twist 10 -10; bend 5 -5",
        ),
    ),
    rest=Move("hits", "", "low . bent .", "bent . low .", "pop 9 0; look 12 0 -12 0", 1),
)  # fmt: skip
