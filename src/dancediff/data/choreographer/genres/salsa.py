"""Salsa on 1: three quick steps and a pause, the hips roll over each standing leg."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

SALSA = Genre(
    name="salsa",
    tempo=(84, 116),
    energy=1.0,
    groove=Groove(
        height=0.94, bounce=0.012, offbeat=0.0, rock=1, sway=7, hip=10, hip_twist=10, shift=0.9
    ),
    style=Style(
        attack=0.9, snap=0.15, flow=0.15, lag=0.1, smooth=1.1, toe_out=12, stance=0.085, lift=0.05,
        point=0.4,
    ),
    moves=(
        Move(
            "basic",
            "L1 0 .20; R2 0 0; L3 0 0; L4 0 .02 tap; R5 0 -.20; L6 0 0; R7 0 0; R8 0 .02 tap",
            "frame scoop frame belt", "belt frame scoop frame",
            "rib 5 -5 5 -3 -5 5 -5 3; twist 8 -6 6 0 -8 6 -6 0; shrug 3 0", energy=1,
        ),
        Move(
            "side basic",
            "L1 .24 0; R2 0 0; L3 0 0; L4 0 .02 tap; R5 -.24 0; L6 0 0; R7 0 0; R8 0 .02 tap",
            "second frame frame belt frame . belt frame",
            "frame . belt frame second frame frame belt",
            "bend -5 3 -3 0 5 -3 3 0; twist 8 -4 4 0 -8 4 -4 0; look 15 0 0 0 -15 0 0 0", energy=1,
        ),
        Move(
            "back break",
            "L1 -.08 -.22; R2 0 0; L3 .04 0; L4 0 .02 tap; R5 .08 -.22; L6 0 0; R7 -.04 0;"
            "R8 0 .02 tap",
            "low . scoop frame second second frame belt",
            "second second frame belt low . scoop frame",
            "twist 22 4 -4 0 -22 -4 4 0; bend 5 0 0 0 -5 0 0 0; look 18 0 0 0 -18 0 0 0", energy=2,
        ),
        Move(
            "cross body walk",
            "L1 0 .20; R2 0 0; L3 .14 -.06; R5 .18 .10; L6 .16 .04; R7 .06 0; L8 0 0;"
            "R8& 0 0",
            "frame . second . frame scoop belt .", "frame . belt . second frame scoop .",
            "twist 10 -8 12 6 -12 8 -6 0; look 10 0 20 10 -15 0 0 0; bend 3 -3 5 0 -5 3 0 0",
            energy=2,
        ),
        Move(
            "right turn", "L1 0 .16; R2 0 0; L3 0 0; R5 0 0; L6 0 0; R7 0 0; L8 0 0 tap",
            "frame . frame raise crown . frame belt", "frame . belt fold fold fold frame frame",
            "face 0 0 0 0 -120 -240 -360 -360; level 1 2 2 3 1 1 1 2", energy=3, whole=True,
        ),
        Move(
            "suzy q",
            "R1 .09 .25; L2 .04 0; R3 .12 .25; L3& .06 0; R4 -.06 0; L5 -.09 .25; R6 -.04 0;"
            "L7 -.12 .25; R7& -.06 0; L8 0 0",
            "side-low belt side-low frame", "belt side-low frame side-low",
            "twist 20 -14 20 0 -20 14 -20 0; bend 4 -4; level 5 4; pitch 6 4", energy=3,
        ),
        Move(
            "shoulder shimmy", "L1 .16 0; L4 .12 0 tap; L5 .1 0; R6 -.1 0; L7 0 0; R8 0 0",
            "second . side-low . second . crown .", None,
            "twist 10 -10 10 -10 12 -12 12 0; pitch 2 6 10 8 4 0 -6 0; level 5 8 12 8 4 3 2 2;"
            "hip 4 -4; shrug 4 0", energy=2,
        ),
        Move(
            "hair comb",
            "L1 0 .18; R2 0 0; L3 0 0; L4 0 .02 tap; R5 0 -.18; L6 0 0; R7 0 0; R8 0 .02 tap",
            "frame . brow* nape* raise . second frame", "second . frame . frame . brow* nape*",
            "rib 5 -5; twist 8 -6 6 0 -8 6 -6 0; look 12 0 -12 0; tilt 5 0 -5 0", energy=3,
        ),
        Move(
            "mambo kicks",
            "R1 .04 .30 air:.28; R2 0 0; L2& 0 0; R3 0 .06; L4 0 0; L5 -.04 .30 air:.28;"
            "L6 0 0; R6& 0 0; L7 0 .06; R8 0 0",
            "frame scoop frame side-low side-low frame scoop frame",
            "side-low frame scoop frame frame scoop frame side-low",
            "twist -12 8 -4 0 12 -8 4 0; pitch -5 4 2 0; level 1 4 2 1", energy=2,
        ),
    ),
    travel=(
        Move(
            "salsa walk", "R1 0 0; L2 0 0", "frame belt frame scoop", "scoop frame belt frame",
            "twist 10 -10; rib 4 -4; bend 3 -3",
        ),
        Move(
            "styled walk", "R1 0 0; L2 0 0", "second frame belt frame", "belt frame second frame",
            "twist 12 -12; bend 4 -4",
        ),
    ),
    rest=Move("hips", "R1 0 0; L2 0 0", "frame belt", "belt frame", "rib 4 -4; twist 6 -6", 1),
)  # fmt: skip
