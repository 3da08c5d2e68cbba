"""Jazz: long lines, kicks, pirouettes and leaps, turned out and lifted."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

JAZZ = Genre(
    name="jazz",
    tempo=(100, 142),
    energy=1.0,
    groove=Groove(height=0.955, bounce=0.03, rock=2, sway=5, hip=5, hip_twist=5, shift=0.85),
    style=Style(
        attack=0.85, snap=0.25, flow=0.1, lag=0.09, smooth=1.0, toe_out=20, stance=0.10, point=0.55
    ),
    moves=(
        Move(
            "jazz square", "R1 .12 .22; L2 -.08 -.12; R3 -.18 -.1; L4 0 0",
            "second belt low second", "low second second belt",
            "twist 16 -8 -12 6; hip -4 4 -4 4; bend 4 -6 4 0; look 12 -8", energy=1,
        ),
        Move(
            "kick ball change", "R1 -.03 .58 air:.52; R2 0 -.08 ball; L2& 0 0; R3 -.14 .05; L4 0 0",
            "second second low hip", "high second low hip",
            "pitch -10 4 4 0; bend 4 0 -6 0; twist -8 0 10 0; level 0 2 6 2", energy=2,
        ),
        Move(
            "chasse reach", "R1 -.26 0; L1& -.18 0 ball; R2 -.46 0; L3 -.30 -.14; R4 -.42 .04;"
            "L5 -.16 0; R5& -.24 0 ball; L6 .04 0; R7 .0 -.14; L8 0 0",
            "second first* second crown second first* high hip",
            "second first* high hip second first* second crown",
            "bend -8 4 -10 0 8 -4 10 0; twist 6 -6 14 0 -6 6 -14 0; look -20 0 -10 0 20 0 10 0",
            energy=1,
        ),
        Move(
            "pirouette", "R1 -.20 .04; L2 0 0; R3 -.10 -.16; R4 .06 .10 air:.34 @-30;"
            "R5 .06 .10 air:.36 @-30; R5& .06 .10 air:.34 @-30; R6 -.14 -.12; L7 .04 0; R8 0 0",
            "second . second second first first second hip",
            "low . first first first first second hip",
            "face 0 0 0 0 -180 -360 -360 -360; level 2 2 8 12 0 4 4 2; pitch 0 0 2 4 0 2 0 0",
            energy=3, whole=True,
        ),
        Move(
            "leap", "R1 0 .14; L2 0 .26; R4 0 .62 leap; L5 0 .50; R6 -.1 .28; L7 0 0; R8 0 0",
            "low second reach* second second low first .",
            "low second wing* second second low first .",
            "pitch 8 6 -6 4 4 0 0 0; level 2 4 0 4 8 4 2 2; nod 0 -4 -6 0 0 0 0 0",
            energy=3, whole=True,
        ),
        Move(
            "layout",
            "R1 -.30 0; L3 .34 .34 air:.40; L4 .06 0; R5 -.14 0; L6 -.05 0 tap; L7 .06 0; R8 0 0",
            "second second high high crown . second hip",
            "second crown side-low low second . hip .",
            "bend -8 -10 -18 -4 8 10 -6 0; pitch 2 2 -12 0 6 4 0 0; look -15 -15 10 10 15 15 0 0;"
            "level 8 4 0 4 6 8 4 2", energy=2,
        ),
        Move(
            "snap walk",
            "R1 0 .16; L2 0 .22; R3 0 .16; L4 0 .10; R5 0 -.1; L6 0 -.14; R7 0 -.06; L8 0 0",
            "low side-low low side-low bent raise bent hip",
            "side-low low side-low low raise bent raise hip",
            "twist 16 -16; bend 5 -5; level 8 8 8 8 3 3 3 2; pitch 10 10 10 8 0 0 0 0; shrug 5 0",
            energy=1,
        ),
        Move(
            "hinge", "R1 -.26 .05; L2 .06 0; L7 0 0; R8 0 0",
            "fan . cross . second . hip .", "cross . fan . second . hip .",
            "level 12 8 20 12 16 8 4 2; hip 6 0 -6 0 6 0 -3 0; rib -8 0 8 0 -8 0 4 0;"
            "bend 10 0 -10 0 8 0 0 0; look 15 0 -15 0 0 0 0 0", energy=2,
        ),
        Move(
            "three-step turn",
            "R1 -.24 0; L2 -.42 0; R3 -.58 0; L4 -.48 0 tap; L5 -.24 0; R6 -.10 0;"
            "L7 0 0; R8 0 0 tap",
            "second first first second second first first second", None,
            "face 0 -120 -240 -360 -360 -240 -120 0; bend 0 0 0 8 0 0 0 -8", energy=3, whole=True,
        ),
    ),
    travel=(
        Move(
            "jazz walk", "R1 0 0; L2 0 0", "low second low first", "first low second low",
            "twist 14 -14; bend 4 -4; level 5 4",
        ),
        Move(
            "chasse", "R1 0 0; L1& 0 0 ball; R2 0 0; L3 0 0; R3& 0 0 ball; L4 0 0",
            "second . first .", "second . first .", "twist 8 -8; level 2 0",
        ),
    ),
    rest=Move("pose", "", "hip . second .", "second . hip .", "hip 4 -4; bend -4 4; twist 6 -6", 1),
)  # fmt: skip
