"""One command measures the packaged TCDiff++ again and fills the tables of its page."""

import doctest
import json
import re
import sys
from pathlib import Path

import pytest

from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import measure_tcdiffpp
from measure_tcdiffpp import COMMANDS, FILLED, RESULTS, Measure, by_song

CONTROL = next(one for one in FILLED if one[0] == "control")


def measure(tmp_path: Path, **options) -> Measure:
    return Measure(Path("shared"), Path("training"), out=tmp_path / "out", **options)


def test_its_examples_hold():
    assert doctest.testmod(measure_tcdiffpp).failed == 0


def test_every_command_names_a_program_and_no_place_is_left_open(tmp_path):
    for name in COMMANDS:
        words = measure(tmp_path).words(name)
        assert words[1] == "-m" or (BENCHMARKS.parent / words[1]).exists(), name
        assert not re.search("[{}]", " ".join(words)), name


def test_a_place_may_have_spaces_in_its_name(tmp_path):
    one = Measure(tmp_path / "my data", Path("training"))
    assert one.words("data_cmu")[5] == str(tmp_path / "my data" / "cmu")
    assert one.words("any_song")[-1] == str(tmp_path / "my data")
    songs = [word for word in one.words("music") if word.endswith(".ogg")]
    assert songs[0].startswith(str(tmp_path / "my data" / "music"))


def test_every_table_has_a_step_that_fills_it():
    for table, step, _ in FILLED:
        assert (RESULTS / f"{table}.json").exists() and step in COMMANDS


def test_a_step_that_is_done_is_not_run_again(tmp_path, monkeypatch):
    ran = []
    monkeypatch.setattr(measure_tcdiffpp, "FILLED", ())
    one = measure(tmp_path, only=("control", "rules"))
    monkeypatch.setattr(one, "step", ran.append)
    one.out.mkdir()
    (one.out / "control.txt").write_text("")
    one.run()
    assert ran == ["rules"]


def test_a_step_that_fails_leaves_no_result(tmp_path, monkeypatch):
    one = measure(tmp_path, only=("rules",))
    monkeypatch.setattr(
        one, "words", lambda _: [sys.executable, "-c", "print(1); raise SystemExit(3)"]
    )
    with pytest.raises(measure_tcdiffpp.subprocess.CalledProcessError):
        one.run()
    assert [path.name for path in one.out.iterdir()] == ["rules.part"]


def test_numbers_and_date_of_a_table_change_and_its_head_stays(tmp_path, monkeypatch):
    table = {"about": "A", "date": "2001-01-01", "columns": ["control", "error cm"], "rows": []}
    (tmp_path / "control.json").write_text(json.dumps(table))
    monkeypatch.setattr(measure_tcdiffpp, "RESULTS", tmp_path)
    one = measure(tmp_path)
    one.fill(*CONTROL)  # nothing was measured: nothing changes
    assert json.loads((tmp_path / "control.json").read_text()) == table
    one.out.mkdir()
    (one.out / "control.txt").write_text("| control | error cm |\n| start | 0.5, at worst 1.25 |\n")
    one.fill(*CONTROL)
    now = json.loads((tmp_path / "control.json").read_text())
    assert now["rows"] == [["start", 0.5, 1.25]]
    assert now["date"] > "2001-01-01" and now["about"] == "A"


def test_songs_keep_their_short_names_and_must_be_as_many():
    table = {"rows": [["Ocean", 1, 2, 3, 4], ["mean", None, 2, 3, 4]]}
    printed = (
        "| hr-ocean | 124 | 0.774 | 0.421 | 0.466 |\n| all | | 0.774 | 0.421 | 0.466 | own / 2"
    )
    ours = [["Ocean", 124, 0.77, 0.42, 0.47], ["mean", None, 0.77, 0.42, 0.47]]
    assert by_song(table, printed) == ours
    with pytest.raises(ValueError, match="1 songs"):
        by_song(table, printed.splitlines()[0])


def test_a_metric_that_was_not_printed_is_an_error():
    table = {"columns": ["metric", "now"], "rows": [["GMR", 1.0]]}
    with pytest.raises(KeyError, match="GMR"):
        measure_tcdiffpp.by_metric(table, "| FID_k | 5 |", {"now": 1})
