"""Bollywood with classical Indian flavour: bent knees, lotus hands, stamps, hips and shoulders."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

BOLLYWOOD = Genre(
    name="bollywood",
    tempo=(88, 128),
    energy=1.05,
    groove=Groove(height=0.915, bounce=0.04, rock=3, sway=7, hip=7, hip_twist=5, shift=0.8),
    style=Style(
        attack=0.8, snap=0.3, lag=0.09, smooth=0.9, toe_out=30, stance=0.12, lift=0.10, point=0.2
    ),
    moves=(
        Move(
            "bhangra", "R1 0 .04 ^.16; L2 0 .04 ^.16", "raise lotus", "lotus raise",
            "bend 8 -8; level 2 5; shrug 8 0; tilt 6 -6", energy=2,
        ),
        Move(
            "lotus sway", "R1 -.26 0; L2 -.16 -.04 tap; L3 .05 0; R4 .03 -.04 tap",
            "lotus . lotus . hip . hip .", "hip . hip . lotus . lotus .",
            "bend 9 12 -9 -12; hip -5 -3 5 3; look 20 20 -20 -20; tilt 8 0 -8 0; level 5 8",
            energy=1,
        ),
        Move(
            "aramandi stamps", "R1 -.08 0 ^.14; L2 .08 0 ^.14; R3 -.08 .22 heel; R4 -.08 0;"
            "L5 .08 0 ^.14; R6 -.08 0 ^.14; L7 .08 .22 heel; L8 0 0",
            "chest chest second chest chest chest lotus chest",
            "chest chest lotus chest chest chest second chest",
            "level 14 14 10 14; bend 0 0 -8 0 0 0 8 0; look 0 0 -25 0 0 0 25 0; tilt 6 -6",
            energy=3,
        ),
        Move(
            "light bulb", "R1 -.12 0; L3 .04 0 tap; L5 .06 0; R7 0 0 tap; R8 0 0",
            "high fan high fan hip . hip .", "hip . hip . high fan high fan",
            "hip 6 -2 6 -2 -6 2 -6 2; bend -6 -2 -6 -2 6 2 6 2; look 18 18 18 18 -18 -18 -18 -18;"
            "level 3 6",
            energy=2,
        ),
        Move(
            "shoulder pops", "R1 -.16 0; L4 .1 0; R8 0 0", "lotus . fan . lotus . chest .", None,
            "twist 10 -10 10 -10 12 -12 12 0; shrug 10 0; level 5 9 5 9 12 8 5 3; nod 4 -4",
            energy=3,
        ),
        Move(
            "veil", "R1 -.12 .14; L2 0 .04 tap; L3 .12 .0; R4 0 0 tap",
            "face . second . brow . fan .", "second . face . fan . brow .",
            "twist 12 4 -12 -4; look -16 12 16 -12; tilt 8 -6 -8 6; bend 5 0 -5 0", energy=1,
        ),
        Move(
            "namaste bend", "R1 -.20 -.08; L3 .05 0; R5 -.02 .04; L8 0 0",
            "pray . crown . lotus . pray .", None,
            "level 10 14 6 2 12 8 6 3; pitch 8 4 -6 -8 0 4 6 0; nod 10 4 -8 -8 0 0 8 0;"
            "hip 0 0 5 -5 5 -5 0 0",
            energy=1, whole=True,
        ),
        Move(
            "chakkar",
            "R1 0 0; L2 0 0; R3 0 0; L4 0 0; R5 -.08 0 ^.14; L6 .08 0 ^.14; R7 0 .2 heel; R8 0 0",
            "second second lotus second crown . lotus chest",
            "chest crown crown crown crown . second chest",
            "face 0 90 180 270 360 360 360 360; level 4 4 4 4 12 12 8 6; look 0 0 0 0 0 0 20 0",
            energy=3,
            whole=True,
        ),
        Move(
            "bounce jump",
            "R1 -.10 0; L2 .05 0; R3 -.10 0 jump; L3 .10 0 jump; R5 0 .2 heel; R6 0 0;"
            "L7 0 .2 heel; L8 0 0",
            "raise lotus high raise lotus chest second chest",
            "lotus raise high raise second chest lotus chest",
            "level 4 8 2 8 5 6 5 4; bend 6 -6 0 0 -8 0 8 0; look 0 0 0 0 -20 0 20 0", energy=3,
            whole=True,
        ),
    ),
    travel=(
        Move(
            "dandiya walk", "R1 0 0 ^.13; L2 0 0 ^.13", "lotus raise", "raise lotus",
            "twist 12 -12; bend 6 -6; tilt 5 -5; level 3 5",
        ),
        Move(
            "skirt walk", "R1 0 0; L2 0 0", "hip . fan .", "fan . hip .",
            "hip 4 -4; bend 6 -6; look 10 -10",
        ),
    ),
    rest=Move("clap sway", "", "chest pray", None, "hip 4 -4; bend -4 4; tilt 5 -5; level 4 6", 1),
)  # fmt: skip
