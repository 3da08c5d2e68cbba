"""Locking: wide points and wrist rolls that freeze in the lock, playful and bouncy."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

LOCKING = Genre(
    name="locking",
    tempo=(98, 122),
    energy=1.1,
    groove=Groove(height=0.92, bounce=0.05, rock=6, sway=6, hip=4, hip_twist=4, shift=0.75),
    style=Style(attack=0.55, snap=0.6, lag=0.05, smooth=1.0, toe_out=16, stance=0.12, point=0.3),
    moves=(
        Move(
            "twirl and lock", "R1 -.14 0; L3 .04 0; R8 0 0",
            "fan raise* lock . fan raise* lock .", None,
            "pitch -4 -6 16 12; level 0 0 12 9; shrug 3 3 0 0; nod -4 -6 4 4", energy=2,
        ),
        Move(
            "point", "R1 -.24 0; L2 -.16 0 tap; L3 .05 0; R4 0 0 tap",
            "out . pump . hip . hip .", "hip . hip . out . pump .".replace("out", "high"),
            "twist 20 10 -20 -10; bend 9 0 -9 0; look 30 0 -30 0; level 2 6", energy=1,
        ),
        Move(
            "uncle sam", "R1 0 .18; R3 0 0; L5 0 .18; L7 0 0",
            "pump . pump . reach . lock .", "reach . lock . pump . pump .",
            "twist 16 8 -8 0 -16 -8 8 0; pitch 10 4 14 6; level 4 2 12 4; nod 6 -4", energy=1,
        ),
        Move(
            "scooby walk", "R1 -.12 .24 heel; R2 0 .05; L3 .12 .24 heel; L4 0 .05",
            "scoop chest low belt", "low belt scoop chest",
            "pitch -8 6; twist -12 6 12 -6; bend 6 0 -6 0; level 2 8", energy=2,
        ),
        Move(
            "kick and lock", "R1 -.04 .60 air:.46; R2 0 0; L3 .04 .60 air:.46; L4 0 0; R5 -.2 0;"
            "L6 .08 0; R7 0 0; L8 0 0",
            "high low high low fan raise* lock .", "low high low high fan raise* lock .",
            "pitch -10 6 -10 6 -4 -6 16 6; level 0 5 0 5 0 2 14 4; twist -8 0 8 0 0 0 0 0",
            energy=3,
        ),
        Move(
            "stop and go",
            "R1 -.30 0; L2 -.24 0 tap; L3 .06 0; R4 .24 0 tap; R5 0 0; L7 .1 0; L8 0 0",
            "low chest out . bent low lock .", "out . low chest bent low lock .",
            "bend 10 4 -10 -4 0 0 0 0; twist 12 0 -12 0 8 -8 0 0; level 2 8 2 8 4 2 14 4",
            energy=2,
        ),
        Move(
            "clap jump",
            "R1 -.12 0; L2 .05 0; R3 -.14 0 jump; L3 .14 0 jump; R5 0 0 jump; L5 0 0 jump;"
            "R7 -.16 0; R8 0 0",
            "low . high . first . lock .", None,
            "pitch 8 8 -6 4 8 4 16 4; level 4 8 2 6 2 6 14 4; nod 4 0 -6 0", energy=3, whole=True,
        ),
        Move(
            "spin and point", "R1 -.1 0; L2 0 0; R3 0 0; L4 0 0; R5 -.2 0; L7 .06 0; R8 0 0",
            "belt fold fold belt hip . lock .", "belt fold fold belt high . lock .",
            "face 0 -120 -240 -360 -360 -360 -360 -360; level 3 2 2 2 0 4 14 4;"
            "bend 0 0 0 0 -12 -4 0 0; look 0 0 0 0 -30 0 0 0", energy=3, whole=True,
        ),
        Move(
            "hip roll", "R1 -.16 0; R8 0 0", "hip . brow . hip . goal .",
            "hip . goal . hip . brow .",
            "hip 7 0 -7 0; roll 6 0 -6 0; level 6 10; twist 10 0 -10 0; rib -6 0 6 0", energy=1,
        ),
    ),
    travel=(
        Move(
            "strut", "R1 0 0 ^.12; L2 0 0 ^.12", "scoop pump", "pump scoop",
            "twist 16 -16; nod 4 -4",
        ),
        Move("lock walk", "R1 0 0; L2 0 0", "fan low", "low fan", "bend 7 -7; twist 10 -10"),
    ),
    rest=Move("groove", "", "belt low", "low belt", "twist 10 -10; level 4 0; hip 3 -3", 1),
)  # fmt: skip
