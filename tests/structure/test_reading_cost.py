"""How much there is to read before one has followed a forward pass of the plain papers.

Every file of which a function is entered counts in whole: its lines with code, without docstrings,
comments and blank lines. Lodge's pass is that of both stages and of the style token. Its Foot
Refine Block looks at where the feet are, so it enters forward kinematics, too. That is geometry
which all of the library shares; its files are listed apart, their lines count.
"""

import ast
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from code_lines import code_lines, docstring_lines
from dancediff.diffusion.conditions import Conditions
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from places import SOURCE

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
STEP = torch.tensor([500])
FORWARD_KINEMATICS = {
    "lookup.py",
    "motion/contact.py",
    "motion/representation.py",
    "motion/rotation.py",
    "motion/skeleton.py",
}


def files_entered(call: Callable[[], object]) -> set[str]:
    """Files of the library of which a function is entered."""
    entered: set[str] = set()

    def note(frame, event, _):
        if event == "call":
            entered.add(frame.f_code.co_filename)

    sys.setprofile(note)
    try:
        call()
    finally:
        sys.setprofile(None)
    inside = (Path(name) for name in entered if Path(name).is_relative_to(SOURCE))
    return {path.relative_to(SOURCE).as_posix() for path in inside}


def lines_of(files: set[str]) -> int:
    """Lines with code of all of them."""
    texts = ((SOURCE / name).read_text(encoding="utf-8") for name in files)
    return sum(len(code_lines(text) - docstring_lines(ast.parse(text))) for text in texts)


@pytest.fixture(scope="module")
def tcdiffpp_pass() -> Callable[[], object]:
    model = TCDiffPP(TCDiffPPConfig(**SIZES, fusion_hidden=32)).eval()
    conditions = Conditions(torch.randn(1, 20, 35), swap=torch.arange(3)[None])
    x_t = torch.randn(1, 3, 20, 151)
    return lambda: model.denoise(x_t, STEP, conditions)


@pytest.fixture(scope="module")
def lodge_pass() -> Callable[[], object]:
    model = Lodge(LodgeConfig(GlobalConfig(**SIZES), LocalConfig(**SIZES))).eval()
    first, second = model.global_stage, model.local_stage
    song, M = Conditions(torch.randn(1, 1024, 35)), torch.randn(1, 256, 35)
    made = second.style(torch.tensor([0]), torch.randn(1, 256))
    local = Conditions(M, style=made)

    def both() -> None:
        first.denoise(torch.randn(1, 104, 139), STEP, song)
        second.style(torch.tensor([0]), torch.randn(1, 256))
        second.denoise(torch.randn(1, 256, 139), STEP, local)

    return both


def test_tcdiffpp_is_read_in_8_files_and_600_lines(tcdiffpp_pass):
    files = files_entered(tcdiffpp_pass)
    assert len(files) <= 8 and lines_of(files) <= 600, (sorted(files), lines_of(files))


def test_lodge_is_read_in_10_files_and_with_kinematics_in_900_lines(lodge_pass):
    files = files_entered(lodge_pass)
    assert files >= FORWARD_KINEMATICS
    assert len(files - FORWARD_KINEMATICS) <= 10, sorted(files)
    assert lines_of(files) <= 900, (sorted(files), lines_of(files))


def test_files_are_counted(tcdiffpp_pass):
    assert "papers/tcdiffpp/model.py" in files_entered(tcdiffpp_pass)
    assert files_entered(lambda: None) == set()
    text = '"""One.\n\nTwo."""\n\nx = (\n    1\n)  # three lines\n\ndef f():\n    """No."""\n'
    assert len(code_lines(text) - docstring_lines(ast.parse(text))) == 4


def test_long_files_say_what_to_read_first():
    silent = []
    for path in SOURCE.rglob("*.py"):
        text = path.read_text(encoding="utf-8")
        doc = ast.get_docstring(ast.parse(text)) or ""
        code = lines_of({path.relative_to(SOURCE).as_posix()})
        if (code > 100 or len(text.splitlines()) > 120) and "Read first: " not in doc:
            silent.append(path.name)
    assert silent == [], "a long file, and no line 'Read first: ...' on top"
