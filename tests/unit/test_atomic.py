"""`dancediff.atomic`."""

import tomllib
from pathlib import Path

import pytest

import dancediff
from dancediff.atomic import UNFINISHED, atomic_write, write_text, write_toml


def test_a_file_appears_when_it_is_whole(tmp_path):
    path = tmp_path / "film.mp4"
    with atomic_write(path) as part:
        part.write_text("half")
        assert not path.exists() and part.parent == tmp_path
        assert part.suffix == ".mp4" and part.name.startswith(UNFINISHED)
    assert path.read_text() == "half" and list(tmp_path.iterdir()) == [path]


def test_the_old_file_outlives_a_failure(tmp_path):
    path = tmp_path / "words.txt"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), atomic_write(path) as part:
        part.write_text("new")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_tables_are_read_as_they_were_written(tmp_path):
    tables = {
        "data": {"folder": 'songs "of\\mine" \N{VIOLIN}', "mirror": 0.5, "varied": False},
        "model": {"extensions": ["ssd", "beat_phase"], "d_model": 64},
        "train": {"lr": 1e-30},
        "weights": {},
    }
    write_toml(tmp_path / "new" / "a.toml", tables)
    assert tomllib.loads((tmp_path / "new" / "a.toml").read_text(encoding="utf-8")) == tables


def test_a_text_that_cannot_be_written_leaves_the_old_one(tmp_path):
    path = tmp_path / "words.txt"
    write_text(path, "old")
    with pytest.raises(UnicodeEncodeError):
        write_text(path, "half \ud800")
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_no_writer_does_it_by_hand():
    """A file that is written beside its place and moved there goes through `atomic_write`."""
    source = Path(dancediff.__file__).parent
    by_hand = [
        str(file.relative_to(source))
        for file in source.rglob("*.py")
        if ".part" in (text := file.read_text(encoding="utf-8")) and "part.replace(" in text
    ]
    assert sorted(by_hand) == ["atomic.py", "data/take_file.py"]


def test_an_error_names_the_file_that_was_asked_for(tmp_path):
    path = tmp_path / "nowhere" / "a.txt"
    with pytest.raises(FileNotFoundError) as caught, atomic_write(path) as part:
        part.write_text("words")
    assert caught.value.filename == str(path)
