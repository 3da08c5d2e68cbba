"""An evaluation that was stopped goes on: what is kept gives the same table."""

import json

import numpy as np
import pytest

from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.metrics import measure_all as many
from dancediff.metrics.kept import keep, kept_path, read_kept
from dancediff.metrics.measure import measure
from dancediff.metrics.report import evaluate_dances

BEATS = np.arange(0.2, 12, 0.5)


@pytest.fixture
def dances(tmp_path):
    folder = tmp_path / "dances"
    folder.mkdir()
    for k in range(3):
        dance, _ = choreograph(BEATS, dancers=1 + k, seed=k, seconds=11.0)
        dance.save(folder / f"{k}.npz")
    return folder


@pytest.fixture
def measured(monkeypatch):
    """Names of the dances that are really measured."""
    names = []

    def noting(source, **options):
        names.append(source.stem)
        return measure(source, **options)

    monkeypatch.setattr(many, "measure", noting)
    return names


def test_nothing_is_measured_twice(dances, tmp_path, measured):
    plain = evaluate_dances(dances, song=list(BEATS)).to_json()
    measured.clear()
    for expected in (["0", "1", "2"], []):
        report = evaluate_dances(dances, song=list(BEATS), kept=tmp_path / "kept")
        assert report.to_json() == plain and measured == expected
        measured.clear()
    choreograph(BEATS, dancers=2, seed=9, seconds=11.0)[0].save(dances / "1.npz")
    evaluate_dances(dances, song=list(BEATS), kept=tmp_path / "kept")
    assert measured == ["1"]  # another dance
    evaluate_dances(dances, song=list(BEATS + 0.1), kept=tmp_path / "kept")
    evaluate_dances(dances, song=list(BEATS), window=60, kept=tmp_path / "kept")
    assert measured == ["1", *"012", *"012"]  # other beats, other windows


def test_a_stopped_evaluation_goes_on(dances, tmp_path, monkeypatch):
    def stopping(source, **options):
        if source.stem == "2":
            raise KeyboardInterrupt
        return measure(source, **options)

    monkeypatch.setattr(many, "measure", stopping)
    with pytest.raises(KeyboardInterrupt):
        evaluate_dances(dances, kept=tmp_path / "kept")
    assert len(list((tmp_path / "kept").iterdir())) == 2
    seen = []
    monkeypatch.setattr(many, "measure", lambda s, **o: seen.append(s.stem) or measure(s, **o))
    evaluate_dances(dances, kept=tmp_path / "kept")
    assert seen == ["2"]


def test_every_number_comes_back(dances, tmp_path):
    found = measure(dances / "1.npz", beats=BEATS)
    assert found.drift is not None and found.rows and found.missing
    keep(tmp_path / "one.json", found)
    again = read_kept(tmp_path / "one.json")
    assert again.numbers == found.numbers and again.missing == found.missing
    for name, rows in found.rows.items():
        for one, other in zip(again.rows[name], rows, strict=True):
            assert one.dtype == other.dtype and np.array_equal(one, other)
    assert np.array_equal(again.drift.values, found.drift.values)
    assert again.drift.names == found.drift.names


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"rows": 5}', '{"rows": {}, "numbers": {}}']
)
def test_a_damaged_file_is_measured_anew(dances, tmp_path, measured, text):
    kept = tmp_path / "kept"
    evaluate_dances(dances, kept=kept)
    for path in kept.iterdir():
        path.write_text(text)
    measured.clear()
    evaluate_dances(dances, kept=kept)
    assert measured == ["0", "1", "2"]
    assert all(json.loads(path.read_text())["numbers"] for path in kept.iterdir())


def test_a_changed_metric_of_ones_own_is_measured_anew(dances, tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    path = tmp_path / "kept_metric_of_mine.py"
    names = set()
    for text in ("def one(joints, *, fps):\n    return 1.0\n", "one = max\n"):
        path.write_text(text)
        monkeypatch.delitem(__import__("sys").modules, "kept_metric_of_mine", raising=False)
        own = ("kept_metric_of_mine:one",)
        names.add(kept_path(tmp_path, dances / "0.npz", None, None, metrics=own))
    assert len(names) == 2


def test_the_command_keeps(dances, tmp_path, capsys):
    command = ["evaluate", str(dances), "--workers", "1", "--json", "--keep", str(tmp_path / "k")]
    said = []
    for _ in range(2):
        assert main(command) == 0
        said.append(capsys.readouterr().out)
    assert said[0] == said[1] and len(list((tmp_path / "k").iterdir())) == 3
