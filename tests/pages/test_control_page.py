"""docs/control.md: its examples run, one after the other."""

import re

import pytest
import torch

import dancediff as dd
from dancediff.generation.pipeline import pipeline_of
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from places import DOCS

PAGE = DOCS / "control.md"
BLOCKS = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), flags=re.DOTALL)


def test_the_examples_run():
    assert len(BLOCKS) == 8
    names: dict = {}
    for number, block in enumerate(BLOCKS):
        exec(compile(block, f"control.md, example {number}", "exec"), names)
    assert names["dance"].num_frames == 150 and names["dance"].num_dancers == 3


def test_every_kind_of_control_has_an_example():
    text = "".join(BLOCKS)
    for word in ("swap=", "start=", "end=", "WalkAlong(", "seconds=[", "joints=", "dancers=[0]"):
        assert word in text, word


def test_without_the_spectrum_of_the_data_there_is_no_constraint():
    torch.manual_seed(0)
    config = TCDiffPPConfig(d_model=16, num_heads=2, num_layers=1, ff_dim=32, fusion_hidden=48)
    with pytest.raises(ValueError, match="start=, end= and constraints= need"):
        pipeline_of(TCDiffPP(config)).generate(
            dd.packaged_song(), dancers=2, seconds=2, steps=1, start=[(-1, 0), (1, 0)]
        )
