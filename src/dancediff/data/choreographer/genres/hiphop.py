"""Hip-hop: deep bounce on every beat, loose arms, weight low."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

HIPHOP = Genre(
    name="hiphop",
    tempo=(82, 112),
    energy=1.0,
    groove=Groove(height=0.905, bounce=0.065, rock=9, sway=7, hip=3, hip_twist=4, shift=0.7),
    style=Style(attack=0.7, snap=0.35, lag=0.08, smooth=1.0, toe_out=12, stance=0.125, point=0.2),
    moves=(
        Move(
            "two step", "R1 -.30 0; L2 -.22 0 tap; L3 .04 0; R4 .02 0 tap",
            "pump . bent . pump . scoop .", "bent . pump . scoop . pump .",
            "bend 8 3 -8 -3; twist 10 -6 -10 6; level 3 0; nod 6 -2", energy=1,
        ),
        Move(
            "heel rock", "R1 -.14 .24 heel; R2 0 0; L3 .14 .24 heel; L4 0 0",
            "low scoop low pump", "pump scoop low scoop",
            "pitch -6 8; bend -9 0 9 0; twist -14 0 14 0; look -14 0 14 0; shrug 6 0", energy=1,
        ),
        Move(
            "lean back", "R1 -.20 0; R8 0 0",
            "drop . scoop . bent bent belt .", "belt . bent bent drop . scoop .",
            "level 5 12 5 14 5 12 5 3; bend 10 4 -10 -4; rib 8 -8; pop 6 -4; nod 8 -4", energy=1,
        ),
        Move(
            "knee march", "R1 0 .03; L1& .0 .10 air:.30 @6; L2 0 .03; R2& 0 .10 air:.30 @-6",
            "pump scoop", "scoop pump",
            "twist 16 -16; pitch 10 6; shrug 4 0; nod 5 -3", energy=3,
        ),
        Move(
            "cabbage patch", "R1 -.20 0; L2 .06 0; L4 .06 0 tap; L5 .06 0; R8 0 0",
            "belt . scoop* . front* . chest* .", None,
            "twist 14 10 -14 -10; hip 5 3 -5 -3; level 6 2; pop 5 -5", energy=2,
        ),
        Move(
            "cross jump", "R1 -.16 0 jump; L1 .16 0 jump; R3 .12 .10 jump; L3 -.12 -.10 jump;"
            "R5 -.12 0 jump; L5 .12 0 jump; R7 0 0; L8 0 0",
            "low . cross . low . scoop pump", None,
            "pitch 4 6 10 6 4 6 8 4; level 2 4 4 4 2 6 10 3; nod 4 -4", energy=3, whole=True,
        ),
        Move(
            "walk-around", "R1 0 0; L2 0 0; R3 0 0; L4 0 0; R5 -.2 .1; L6 .2 .1; R7 0 0; L8 0 0",
            "bent pump bent low drop . hip .", "pump bent pump low drop . hip .",
            "face 0 -90 -180 -270 -360 -360 -360 -360; level 4 4 4 4 16 12 4 2;"
            "bend 4 -4 4 -4 0 0 0 0; pitch 6 6 6 6 14 8 2 2", energy=2, whole=True,
        ),
        Move(
            "drop and stomp", "R1 -.24 .08; L3 .05 0; R5 0 .2 air:.4; R6 0 0; L7 .2 0; L8 0 0",
            "low . scoop . lock . low hip", "cross . low . pump . low hip",
            "level 16 10 20 8 2 6 12 2; pitch 16 6 18 4 -4 10 12 2; bend 8 0 -10 0 4 0 8 0;"
            "twist 20 10 -20 -10 0 0 16 0", energy=3,
        ),
        Move(
            "arm wave", "R1 -.16 0; L5 .06 0; R8 0 0",
            "out wave-up* out* wave-down* out* side-low low .",
            "hip . . . hip . . .",
            "bend 4 -6 -10 -4 4 6 2 0; rib 6 10 4 -4 -10 -6 0 0; level 6 2;"
            "look 20 25 20 10 0 0 0 0",
            energy=1,
        ),
        Move(
            "bounce kick", "R1 0 .30 air:.32; R2 -.16 0; L3 0 .30 air:.32; L4 .16 0; R5 -.2 -.1;"
            "L6 -.1 -.1 tap; L7 .1 0; R8 0 0",
            "pump bent scoop bent low . belt hip", "scoop bent pump bent low . belt hip",
            "pitch -8 10 -8 10 8 6 4 2; twist -16 8 16 -8 18 14 -8 0; level 0 8 0 8 10 8 4 2",
            energy=3,
        ),
    ),
    travel=(
        Move(
            "strut", "R1 0 0; L2 0 0", "pump scoop", "scoop pump",
            "twist 14 -14; bend 5 -5; nod 5 0; level 3 1",
        ),
        Move(
            "low walk", "R1 0 0; L2 0 0", "low bent", "bent low",
            "twist 10 -10; level 7 5; pitch 8 5; shrug 4 0",
        ),
    ),
    rest=Move("groove", "", "bent pocket", "pocket bent", "twist 9 -9; rib 5 -5; level 3 1", 1),
)  # fmt: skip
