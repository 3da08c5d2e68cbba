"""K-pop: sharp pictures on every count, precise arms, quick level changes, small jumps."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

KPOP = Genre(
    name="kpop",
    tempo=(98, 138),
    energy=1.1,
    groove=Groove(height=0.94, bounce=0.034, rock=3, sway=5, hip=5, hip_twist=4, shift=0.8),
    style=Style(attack=0.6, snap=0.5, lag=0.05, smooth=1.0, toe_out=10, stance=0.11, point=0.35),
    moves=(
        Move(
            "point dance", "R1 -.16 0; L2 -.04 0 tap; L3 .05 0; R4 0 0 tap",
            "hip hip high cross", "high cross hip hip",
            "bend 9 -6 -9 6; twist -12 12 12 -12; hip 5 0 -5 0; look -20 10 20 -10", energy=2,
        ),
        Move(
            "heart beat", "R1 -.14 0; L4 .04 0; R8 0 0",
            "heart heart out heart chin . low .", "heart heart out heart hip . low .",
            "pop 9 -4 4 -4 6 0 4 0; level 3 6 2 6 8 5 4 2; tilt 0 0 8 0 -10 -8 0 0;"
            "hip 0 0 0 0 5 0 -4 0",
            energy=1,
        ),
        Move(
            "arm boxes", "R1 -.16 0; R8 0 0",
            "goal tut-in front chest goal-down cross up hip",
            "goal-down chest front tut-in goal cross up hip",
            "twist 8 -8 0 8 -8 0 0 0; rib 6 -6; level 4 4 8 4 4 10 0 4; look 10 -10 0 10 -10 0 0 0",
            energy=3,
        ),
        Move(
            "side slide",
            "R1 -.36 0; L2 -.24 0; L4 .08 0; R5 .10 0 tap; R6 -.14 0; L7 .04 0; R8 0 0",
            "low across . out chest . belt low", "out chest . low across . belt low",
            "bend 14 6 0 -12 -4 0 0 0; level 10 4 2 10 6 8 3 2; twist 12 0 0 -12 0 8 -8 0;"
            "look -15 0 0 15 0 0 0 0",
            energy=2,
        ),
        Move(
            "hip groove", "R1 -.14 0; L5 .04 0; R8 0 0",
            "hip . brow . hip belt side-low low", "brow . hip . side-low belt hip low",
            "hip 7 -7 7 0 -7 7 -7 0; roll 5 -5 5 0 -5 5 -5 0; rib -5 5; level 6 6 10 6 6 10 6 2;"
            "look 12 12 -12 -12",
            energy=1,
        ),
        Move(
            "step clap",
            "R1 0 .16; L2 0 .16 tap; L3 0 0; R4 0 0 tap; R5 -.2 0; L6 -.1 0 tap; L7 0 0; R8 0 0",
            "bent front low scoop out chest out hip", "bent front low scoop chest out out hip",
            "pitch 6 -2 4 0; twist 10 0 -10 0 14 -14 0 0; bend 0 0 0 0 8 -4 0 0; level 2 5",
            energy=1,
        ),
        Move(
            "jump cut", "R1 -.05 0; L2 0 0; R3 -.14 0 jump; L3 .14 0 jump; L4 .1 0; R5 -.04 0 jump;"
            "L5 .04 0 jump;"
            "R7 -.18 .05; R8 0 0",
            "pump bent high . cross . out low", "bent pump high . cross . brow low",
            "level 3 8 2 6 2 6 16 4; pitch 4 8 -2 4 6 4 8 2; nod 0 4 -5 0 5 0 0 0", energy=3,
            whole=True,
        ),
        Move(
            "drop low", "R1 -.26 .02; L2 .08 0; L6 .06 0 tap; L7 .04 0; R8 0 0",
            "side-low low knee . raise . brow hip", "side-low low low . hip . out hip",
            "level 8 16 30 24 14 6 4 2; pitch 6 12 16 10 2 0 0 0; bend 0 4 10 8 -6 -8 6 0;"
            "look 0 0 15 15 -10 0 15 0",
            energy=3,
        ),
        Move(
            "turn and pose",
            "R1 -.12 0; L2 0 0; R3 0 0; L4 0 0; R5 -.2 .04; L6 .04 0; R7 -.05 0; L8 0 0",
            "bent fold fold low high . chest hip", "bent fold fold low hip . out hip",
            "face 0 -120 -240 -360 -360 -360 -360 -360; bend 0 0 0 0 10 6 -6 0;"
            "level 3 2 2 4 8 4 4 2;"
            "look 0 0 0 0 18 10 -10 0", energy=3, whole=True,
        ),
    ),
    travel=(
        Move(
            "pump walk", "R1 0 0; L2 0 0", "bent low", "low bent",
            "twist 12 -12; bend 4 -4; level 3 1",
        ),
        Move(
            "pose walk", "R1 0 0; L2 0 0", "hip . brow .", "low . hip .",
            "twist 12 -12; hip 4 -4; bend -3 3",
        ),
    ),
    rest=Move("bounce", "", "belt low", "low belt", "twist 7 -7; rib 4 -4; hip 3 -3", 1),
)  # fmt: skip
