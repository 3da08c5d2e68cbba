"""One colour per dancer, the same in every picture.

The colours are those of Okabe and Ito, which stay apart for colour-blind readers. In greyscale two
that follow each other here stay apart, but orange and sky blue, say, are one grey. No picture says
by colour alone who somebody is: numbers stand beside it.
Curves in one picture differ in their dashes, too (`dash`).
"""

DANCER_COLORS = (
    "#0072B2",  # blue
    "#E69F00",  # orange
    "#009E73",  # bluish green
    "#CC79A7",  # reddish purple
    "#D55E00",  # vermillion
    "#56B4E9",  # sky blue
)
DASHES = ("-", "--", "-.", ":")
INK = "#22262B"  # text and marks
MUTED = "#6B7280"  # secondary text
GRID = "#B9C0C9"  # floor lines
PAPER = "#FFFFFF"
WALL = "#E9EDF2"  # behind the dancers
FLOOR = "#F7F5F2"
BEAT = "#D55E00"


def dancer_color(k: int) -> str:
    """Colour of dancer ``k``; a seventh dancer begins again.

    >>> dancer_color(0) == dancer_color(6) == DANCER_COLORS[0]
    True
    """
    return DANCER_COLORS[k % len(DANCER_COLORS)]


def dash(k: int) -> str:
    """Matplotlib's line style of curve ``k``: four curves stay apart without their colours.

    >>> dash(0), dash(5)
    ('-', '--')
    """
    return DASHES[k % len(DASHES)]


def rgb(color: str) -> tuple[float, float, float]:
    """A "#RRGGBB" colour as three numbers in [0, 1].

    >>> rgb("#FF0000")
    (1.0, 0.0, 0.0)
    """
    red, green, blue = (int(color[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue


def ink_on(color: str) -> str:
    """What is read best on a colour: white, or INK on a light one.

    >>> ink_on("#0072B2") == PAPER, ink_on("#E69F00") == INK
    (True, True)
    """
    low, on, high = (_luminance(one) + 0.05 for one in (INK, color, PAPER))
    return PAPER if high / on > on / low else INK  # the contrasts of WCAG


def _luminance(color: str) -> float:
    """How bright a colour is, 0..1, by WCAG."""
    red, green, blue = (
        c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in rgb(color)
    )
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def mix(color, other, amount: float) -> tuple[float, float, float]:
    """``amount`` of ``other`` in ``color``; 0 keeps it, 1 replaces it.

    >>> mix("#000000", "#FFFFFF", 0.25)
    (0.25, 0.25, 0.25)
    """
    a = rgb(color) if isinstance(color, str) else color
    b = rgb(other) if isinstance(other, str) else other
    return tuple((1 - amount) * x + amount * y for x, y in zip(a, b, strict=True))
