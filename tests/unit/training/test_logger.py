"""The log of a training that was cut off goes on from whole lines."""

import pytest

from dancediff.training.logger import Logger


@pytest.mark.parametrize("cut", ["1", "12,", "12,0.1,0.", "5,0.0,", "12,0.0,0.5"])
def test_half_a_line_is_forgotten(tmp_path, cut):
    path = tmp_path / "losses.csv"
    with Logger(path) as log:
        for step in range(12):
            log.write(step, {"total": 0.5})
    with path.open("a") as file:
        file.write(cut)
    with Logger(path, 12) as log:
        log.write(12, {"total": 0.25})
    header, *rows = path.read_text().splitlines()
    assert header == "step,seconds,total"
    assert [row.split(",")[0] for row in rows] == [str(k) for k in range(13)]
    assert all(row.count(",") == 2 for row in rows)


def test_a_row_with_other_columns_is_refused(tmp_path):
    with Logger(tmp_path / "losses.csv") as log:
        log.write(0, {"total": 0.5, "critic": None})
        with pytest.raises(ValueError, match=r"step 1 .*\['total'\].*with None"):
            log.write(1, {"total": 0.5})


@pytest.mark.parametrize("first", [0, 12])
def test_there_is_never_an_empty_log(tmp_path, first):
    """A kill -9 within the first step, which takes seconds, left a file of 0 bytes."""
    path = tmp_path / "losses.csv"
    with Logger(path, first) as log:
        log.flush()
        assert not path.exists()  # nor a hidden one, to be swept
        assert list(tmp_path.glob(".*")) == []
        log.write(first, {"total": 0.5})
        header, row = path.read_text().splitlines()  # can be watched before the first checkpoint
    assert header == "step,seconds,total" and row.startswith(f"{first},")


def test_a_new_training_leaves_the_old_log_until_its_first_checkpoint(tmp_path):
    path = tmp_path / "losses.csv"
    path.write_text("step,seconds,total\n0,0.1,9\n")
    with Logger(path) as log:
        log.write(0, {"total": 0.5})
        assert path.read_text().endswith("0,0.1,9\n")  # a kill now would lose nothing
        log.flush()
        log.write(1, {"total": 0.4})
    assert [row.split(",")[-1] for row in path.read_text().splitlines()] == ["total", "0.5", "0.4"]
    assert [file.name for file in tmp_path.iterdir()] == ["losses.csv"]
