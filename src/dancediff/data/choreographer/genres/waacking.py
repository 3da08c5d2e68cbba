"""Waacking and disco: arms whip round the shoulders and overhead, legs pose."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

WAACKING = Genre(
    name="waacking",
    tempo=(112, 130),
    energy=1.05,
    groove=Groove(height=0.955, bounce=0.026, rock=3, sway=6, hip=8, hip_twist=7, shift=0.85),
    style=Style(
        attack=0.9, snap=0.3, lag=0.12, smooth=0.8, toe_out=14, stance=0.09, lift=0.07, point=0.5
    ),
    moves=(
        Move(
            "whips", "R1 -.14 0; L3 -.06 0 tap; L5 .06 0; R7 .0 0 tap; R8 0 0",
            "out whip* high whip* out whip* crown out", "crown out whip* high whip* out whip* out",
            "bend 6 -4 8 -4 -6 4 -8 4; look 25 0 25 0 -25 0 -25 0; hip 4 4 2 0 -4 -4 -2 0",
            energy=2,
        ),
        Move(
            "double whip", "R1 -.18 0; L4 0 0 tap; L5 .1 0; R8 0 0",
            "whip* out whip* crown* side-low* high . hip", None,
            "pitch -4 4 -4 4 8 -8 -8 0; level 2 4 2 4 12 0 0 2; nod -6 0", energy=3,
        ),
        Move(
            "roll and pose", "R1 -.24 0; L2 -.14 0 tap; L3 .04 0; R4 .02 0 tap",
            "face* crown* out . hip . nape .", "hip . nape . face* crown* out .",
            "bend 8 4 -8 -4; twist 12 6 -12 -6; look 28 20 -28 -20; hip -5 0 5 0", energy=1,
        ),
        Move(
            "disco point", "R1 -.22 0; L2 -.10 0 tap; L3 .06 0; R4 .04 0 tap",
            "hip . hip . high . cross-low .", "high . cross-low . hip . hip .",
            "bend 10 -6 -10 6; twist -10 18 10 -18; hip 6 -3 -6 3; look -28 20 28 -20", energy=2,
        ),
        Move(
            "catwalk arms",
            "R1 0 .22; L2 .0 .22 tap; L3 0 0; R4 0 0 tap; R5 -.12 -.1; L6 0 -.1 tap;"
            "L7 0 0; R8 0 0",
            "second crown* second low second . hip .", "low second crown* second hip . second .",
            "hip 5 3 -5 -3; bend -5 0 5 0; twist 12 6 -12 -6; tilt 6 0 -6 0", energy=1,
        ),
        Move(
            "groove kick", "R1 -.04 .62 air:.48; R2 -.12 0; L3 .04 .62 air:.48; L4 .12 0; R5 -.1 0;"
            "L6 -.06 0 tap; L7 0 0; R8 0 0",
            "high out low out whip* high whip* hip", "low out high out whip* high whip* hip",
            "pitch -10 2 -10 2 0 -6 0 -2; twist 8 0 -8 0 10 -10 0 0; look 0 20 0 -20 0 0 0 0",
            energy=3,
        ),
        Move(
            "spin", "R1 -.2 0; L2 -.35 0; R3 -.5 0; L4 -.42 0 tap; L5 -.25 0; R6 -.15 0; L7 0 0;"
            "R8 0 0 tap",
            "out fold fold high out whip* out hip", "out fold fold hip whip* out whip* high",
            "face 0 -120 -240 -360 -360 -360 -360 -360; bend 0 0 0 8 -4 4 -4 6;"
            "look 0 0 0 25 20 0 -20 -25; hip 0 0 0 4 -4 4 -4 4", energy=3, whole=True,
        ),
        Move(
            "deep pose", "R1 -.34 0; L2 .0 0; L4 .06 0 tap; L5 .08 0; R6 -.1 0; R7 0 0; L8 0 0",
            "out whip* crown . side-low* out whip* hip", "side-low . hip . whip* high* out hip",
            "level 10 18 16 12 8 4 2 2; bend -12 -16 -14 -6 10 6 0 0; pitch 4 10 6 0 0 -6 0 0;"
            "look -25 -30 -20 0 25 0 0 0", energy=2,
        ),
        Move(
            "frame", "R1 -.12 0; L5 .04 0; R8 0 0",
            "brow face temple nape* out face* brow hip",
            "nape temple face brow* hip brow* face out",
            "hip 5 -5; roll 3 -3; tilt 8 -8; look 12 -12; twist 8 -8", energy=1,
        ),
    ),
    travel=(
        Move(
            "strut", "R1 0 0; L2 0 0", "out whip* out low", "low out whip* out",
            "hip 5 -5; twist 10 -10; bend -4 4",
        ),
        Move(
            "disco walk", "R1 0 0; L2 0 0", "hip raise", "raise hip",
            "hip 4 -4; bend 7 -7; look 12 -12",
        ),
    ),
    rest=Move("sway", "", "hip . second .", "second . hip .", "hip 5 -5; roll 3 -3; bend -4 4", 1),
)  # fmt: skip
