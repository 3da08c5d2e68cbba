"""Contemporary and ballet: long flowing phrases, falls and reaches, the arms never stop."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

CONTEMPORARY = Genre(
    name="contemporary",
    tempo=(60, 108),
    energy=0.9,
    groove=Groove(height=0.955, bounce=0.016, rock=2, sway=5, hip=3, hip_twist=4, shift=0.9),
    style=Style(
        attack=1.0, snap=0.0, flow=0.7, lag=0.11, smooth=2.0, toe_out=24, stance=0.09, lift=0.06,
        point=0.65,
    ),
    moves=(
        Move(
            "side reach", "R1 -.40 0; L3 -.26 0 tap; L5 .08 0; R7 .04 0 tap; R8 0 0",
            "first . second . crown . first .", "second . crown . first . second .",
            "bend 12 16 8 -4 -12 -16 -8 4; twist -10 -6 4 8 10 6 -4 -8;"
            "look -18 0 10 10 18 0 -10 -10;"
            "level 8 4 2 2 8 4 2 2", energy=1,
        ),
        Move(
            "roll down", "R1 -.10 0; L4 .04 0; R8 0 0",
            "up . reach . drop . first crown", None,
            "pitch -10 -4 18 34 40 26 6 -6; level 0 2 10 20 24 14 4 0; nod -10 -4 10 18 18 8 0 -8",
            energy=1, whole=True,
        ),
        Move(
            "arabesque",
            "R1 -.02 .24; L2 .02 -.38 air:.24; L3 .04 -.66 air:.46; L4 .04 -.64 air:.44;"
            "L5 .04 -.12; R6 -.06 0; L7 0 0; R8 0 0",
            "first . reach . second . first .", "first . wing . second . first .",
            "pitch 4 14 22 20 8 2 0 0; level 4 2 0 2 8 6 3 2; look 0 -8 -10 -8 0 0 0 0;"
            "nod 0 -8 -12 -10 0 0 0 0",
            energy=2, whole=True,
        ),
        Move(
            "fall and recover",
            "R1 -.44 .10; L2 .04 0; L4 -.10 0 tap; L5 .24 -.10; R6 0 0; R7 -.05 0; L8 0 0",
            "second . drop . wing . crown .", "drop . across . high . second .",
            "bend 16 20 8 0 -14 -10 0 0; level 16 24 12 6 14 8 2 0; pitch 10 18 8 0 -8 -10 0 0;"
            "twist 14 20 0 -10 -16 -6 0 0", energy=3,
        ),
        Move(
            "pirouette", "R1 -.20 .06; L2 0 0; R3 -.12 -.16; R4 .06 .10 air:.36 @-34;"
            "R5 .06 .10 air:.38 @-34; R5& .06 .10 air:.36 @-34; R6 -.12 -.14; L7 .04 0; R8 0 0",
            "second . second . first . second .", "first . first . first . crown .",
            "face 0 0 0 0 -180 -360 -360 -360; level 2 2 8 12 0 5 3 1; pitch 0 0 2 4 0 0 0 -4",
            energy=3, whole=True,
        ),
        Move(
            "leap", "R1 0 .14; L2 0 .28; R4 0 .62 leap; L5 0 .50; R6 -.1 .28; L7 0 0; R8 0 0",
            "first . crown . second . first .", "first . second . wing . first .",
            "pitch 8 4 -6 4 6 2 0 0; level 3 6 0 5 10 5 2 2; nod 0 -6 -8 0 0 0 0 0", energy=3,
            whole=True,
        ),
        Move(
            "body wave", "R1 -.14 .04; L5 .06 .04; R8 0 0",
            "low . wave-down* . out . wave-up* .", "wave-up* . low . wave-down* . out .",
            "pitch 12 -4 -12 2 12 -4 -12 0; pop -8 6 10 0 -8 6 10 0; rib 8 6 -6 -8 8 6 -6 -4;"
            "level 10 6 0 4 10 6 0 2; nod 10 0 -10 0", energy=1,
        ),
        Move(
            "spiral", "R1 0 0; L2 0 0; R3 0 0; L4 0 0; R5 -.24 -.05; L6 -.06 0 tap; L7 0 0; R8 0 0",
            "wing . first . second . crown .", "first . across . crown . second .",
            "face 0 90 180 270 360 360 360 360; level 2 4 6 4 14 10 4 2; bend 6 6 6 4 -12 -8 0 0;"
            "pitch 4 4 4 4 8 4 -4 0", energy=2, whole=True,
        ),
        Move(
            "attitude balance", "R1 -.12 .10; L2 -.02 .14 air:.30 @30; L3 .0 .20 air:.44 @30;"
            "L4 .0 .18 air:.42 @30; L5 .10 -.10; R6 -.04 0 tap; R7 -.1 0; L8 0 0",
            "first . crown . second . first .", "second . second . crown . first .",
            "bend -4 -6 -8 -6 8 6 0 0; pitch -2 -6 -8 -6 2 0 0 0; level 4 1 0 1 8 4 3 2;"
            "look 0 15 20 15 0 -15 0 0",
            energy=2, whole=True,
        ),
    ),
    travel=(
        Move(
            "floating walk", "R1 0 0; L2 0 0", "second . first .", "first . second .",
            "twist 10 -4 -10 4; bend 5 2 -5 -2; level 3 2",
        ),
        Move(
            "run and open", "R1 0 0; L1& 0 0; R2 0 0; L3 0 0; R3& 0 0; L4 0 0",
            "low . wing . second . first .", None, "pitch 8 4 -4 0; level 4 2; nod 0 -4",
        ),
    ),
    rest=Move(
        "breathe", "", "low . first . second . first .", None,
        "pitch 6 2 -4 0; rib 4 0 -4 0; level 3 1", 1,
    ),
)  # fmt: skip
