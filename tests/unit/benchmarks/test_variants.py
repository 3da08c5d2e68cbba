"""Variants of a training config: what a line of changes means, and that each is trained once."""

import sys

import pytest

from dancediff.data.choreographed import choreograph_jobs
from dancediff.data.prepare import prepare
from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
from variants import LEVELS, Variants, changed

CONFIG = """
[data]
dancers_per_batch = 2
[model]
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 16
fusion_hidden = 16
extensions = ["preconditioning"]
[train]
lr = 0.01
"""


def test_a_line_of_changes():
    tables = {"model": {"extensions": ["a", "b"], "d_model": 8}, "train": {"lr": 1.0}}
    new = changed(tables, "+c -a model.d_model=16 train.lr=0.1")
    assert new == {"model": {"extensions": ["b", "c"], "d_model": 16}, "train": {"lr": 0.1}}
    assert tables["model"] == {"extensions": ["a", "b"], "d_model": 8}
    with pytest.raises(ValueError):
        changed(tables, "-nothing")


def test_a_variant_is_trained_once(tmp_path, capsys):
    prepare(
        choreograph_jobs(8, seconds=6.0, sizes=(1, 2), share=0.5), tmp_path / "data",
        progress=False,
    )  # fmt: skip
    config = tmp_path / "config.toml"
    config.write_text(CONFIG)
    variants = Variants(
        config, str(tmp_path / "data"), ("+frame_tokens",), minutes=0.01, out=tmp_path / "out"
    )
    variants.run()
    first = capsys.readouterr().out
    assert "+frame_tokens" in first and f"t = {LEVELS[0]}" in first
    (kept,) = (tmp_path / "out").glob("*.json")
    written = kept.stat().st_mtime_ns
    variants.run()
    assert capsys.readouterr().out == first and kept.stat().st_mtime_ns == written
