import re
from pathlib import Path

import torch

import dancediff
from dancediff.axes import ON_FLOOR
from dancediff.motion.representation import LODGE, TCDIFFPP


def test_frame_rate_and_floor_stand_once():
    """A second `FPS = 30`, or the floor's two columns as bare numbers, would drift apart."""
    wrong = re.compile(r"^FPS\b.*=|\[\.\.\., [\[(]0, 2[\])]\]|root\.start \+ 2", re.MULTILINE)
    for path in Path(dancediff.__file__).parent.rglob("*.py"):
        if path.name != "axes.py" and path.parent.name != "exercises":
            assert not wrong.search(path.read_text(encoding="utf-8")), path
    place = torch.arange(3.0)
    for spec in (TCDIFFPP, LODGE):
        x = torch.zeros(spec.dim)
        x[spec.root] = place
        assert torch.equal(x[spec.floor], place[ON_FLOOR])
        assert (x[spec.lateral], x[spec.height]) == (0, 1)
