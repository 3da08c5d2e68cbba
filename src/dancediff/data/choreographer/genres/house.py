"""House: the jack runs through the torso, quick feet on the off-beats, light and upright."""

from dancediff.data.choreographer.moves import Genre, Groove, Move, Style

HOUSE = Genre(
    name="house",
    tempo=(112, 132),
    energy=1.0,
    groove=Groove(height=0.925, bounce=0.045, rock=12, sway=5, hip=4, hip_twist=5, shift=0.6),
    style=Style(
        attack=0.95, snap=0.1, lag=0.11, smooth=1.2, toe_out=8, stance=0.10, lift=0.07, point=0.3
    ),
    moves=(
        Move(
            "jack", "R1 -.12 0; R8 0 0", "bent pump", "pump bent",
            "pop 8 -8; tuck 8 -4; level 3 0; shrug 4 0; nod 6 -6", energy=1,
        ),
        Move(
            "pas de bourree", "R1 -.20 -.10; L1& -.12 -.06 ball; R2 0 .04; L3 .20 -.10;"
            "R3& .12 -.06 ball; L4 0 .04",
            "bent low bent pump", "bent pump bent low",
            "twist 14 -6 -14 6; bend 6 0 -6 0; level 4 2; pitch 6 3", energy=1,
        ),
        Move(
            "shuffle", "R1 0 .14; L1& .0 .04 air:.14; L2 0 .14; R2& 0 .04 air:.14",
            "scoop pump", "pump scoop", "twist 12 -12; pitch 8 4; level 4 4; nod 4 0", energy=2,
        ),
        Move(
            "loose legs",
            "R1 -.18 .05; L1& .04 .02 air:.16 @20; L2 .02 0; R2& -.10 .05 air:.16 @-20;"
            "R3 -.04 0; L3& .14 .05 air:.16 @20; L4 .12 .04",
            "low side-low low bent", "bent low side-low low",
            "bend 6 -6; hip 3 -3; level 8 6; twist 8 -8; pitch 8 6", energy=3,
        ),
        Move(
            "train",
            "R1 0 .24; L2 0 0 ^.04; R3 0 -.20; L4 0 0 ^.04; R5 0 .24; L6 0 0 ^.04; R7 0 -.1;"
            "R8 0 0",
            "pump scoop pump low", "scoop pump low pump",
            "twist 16 0 -16 0; pitch 10 0 -4 4; pop 6 -4; level 4 2", energy=2,
        ),
        Move(
            "farmer",
            "R1 -.08 .22 heel; R1& 0 0; L2 .04 -.04; L3 .08 .22 heel; L3& 0 0; R4 -.04 -.04",
            "low scoop low pump", "pump low scoop low",
            "pitch -5 8; bend -6 2 6 -2; level 3 6; twist -10 6 10 -6", energy=2,
        ),
        Move(
            "skate", "R1 -.34 -.04; L2 -.12 -.16 tap; L3 .24 -.04; R4 .12 -.16 tap",
            "wing* side-low belt* low", "belt* low wing* side-low",
            "bend 10 12 -10 -12; twist -10 -16 10 16; level 8 14; pitch 8 12; look -14 0 14 0",
            energy=1,
        ),
        Move(
            "stomp turn",
            "R1 0 0; R1& 0 .04 tap; R2 0 0; L2& 0 0; R3 0 0; L3& 0 0; R4 0 0; L5 .2 0;"
            "R6 -.05 -.1 tap; R7 -.05 0; L8 0 0",
            "bent low low bent side-low . belt low", "pump low low bent side-low . low belt",
            "face 0 0 120 240 360 360 360 360; level 4 4 3 3 8 10 4 2; pitch 8 6 4 4 6 8 4 4",
            energy=3, whole=True,
        ),
        Move(
            "hop", "R1 -.10 0; L2 .04 0; R3 -.06 0 jump; L3 .06 0 jump; R5 -.10 .1; L6 .10 .1;"
            "R7 0 0; L8 0 0",
            "bent pump side-low low scoop pump low bent",
            "pump bent side-low low pump scoop bent low",
            "pitch 8 8 2 8 8 4 4 4; level 3 6 2 5 4 3 3 2; pop 6 -6", energy=3, whole=True,
        ),
    ),
    travel=(
        Move(
            "jack walk", "R1 0 0; L2 0 0", "bent pump", "pump bent",
            "pop 7 -5; twist 10 -10; level 3 1",
        ),
        Move(
            "run", "R1 0 0; L1& 0 0; R2 0 0; L3 0 0; R3& 0 0; L4 0 0",
            "pump scoop", "scoop pump", "twist 12 -12; pitch 8 6; level 4 3",
        ),
    ),
    rest=Move("jack in place", "", "bent pump", "pump bent", "pop 6 -6; level 2 0; tuck 5 -3", 1),
)  # fmt: skip
