"""What `make mutants` makes of its list and of what it found."""

import sys

import pytest

from places import BENCHMARKS

sys.path.insert(0, str(BENCHMARKS))
import mutants
from mutants import Fault, table


def fault(name="a", file="nn/decoder.py", old="1 + 1", **options):
    return Fault(name, file, old, "1 + 2", "Sums are wrong.", tests=("test_decoder",), **options)


def test_a_fault_is_put_in_at_its_only_place():
    assert fault().applied("x = 1 + 1\n") == "x = 1 + 2\n"
    for text, times in (("x = 2", 0), ("x = 1 + 1 + 1 + 1", 2)):
        with pytest.raises(ValueError, match=f"a: old occurs {times} times in nn/decoder.py"):
            fault().applied(text)


def test_its_own_examples_and_its_tests_run():
    inside = Fault("a", "nn/ssm.py", "1", "2", "", tests=("test_ssm::test_ref_by_hand",))
    assert inside.covering() == [
        "src/dancediff/nn/ssm.py",
        "tests/unit/nn/test_ssm.py::test_ref_by_hand",
    ]


def test_a_result_is_kept_until_fault_source_or_tests_change(tmp_path, monkeypatch):
    for name in ("src/dancediff/nn/decoder.py", "tests/test_decoder.py", "tests/shared.py"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("before")
    monkeypatch.setattr(mutants, "ROOT", tmp_path)
    keys = [fault().key(), fault(old="3").key()]
    for path in sorted(tmp_path.rglob("*.py")):
        path.write_text("after")
        keys.append(fault().key())
    assert len(set(keys)) == 5 and fault().key() == keys[-1]


def test_the_table_counts_what_lived_and_says_why():
    faults = [fault(), fault("b", equation="Lodge 9"), fault("c", "data/windows.py", lives="slow.")]
    made = table(faults, alive={"c"})
    assert made["rows"][0] == ["`data`", 1, 0, "Sums are wrong: slow."]
    assert made["rows"][1] == ["`nn`", 2, 2, None]
    assert [cell["bold"] for cell in made["rows"][2]] == ["all", 3, 2, "66.7% caught"]
    assert made["about"].endswith("that have one: 1.")
