"""librosa is compiled by one process at a time: numba issue 10128."""

import re
import threading
from importlib.util import find_spec
from pathlib import Path

import pytest
from filelock import FileLock

from dancediff.music import librosa_import
from places import ROOT


@pytest.fixture
def mark(tmp_path, monkeypatch):
    """Of a machine on which librosa was never compiled."""
    path = tmp_path / "mark.txt"
    monkeypatch.setattr(librosa_import, "_mark", lambda: path)
    librosa_import.import_librosa.cache_clear()
    yield path
    librosa_import.import_librosa.cache_clear()


def test_who_comes_second_waits_until_all_is_compiled(mark):
    found = []
    second = threading.Thread(target=lambda: found.append(librosa_import.import_librosa()))
    with FileLock(mark.with_suffix(".lock")):
        second.start()
        second.join(0.5)
        assert second.is_alive() and not mark.exists()
    second.join(240)
    assert found[0].__name__ == "librosa" and mark.exists()


def test_once_compiled_nobody_waits(mark):
    mark.touch()
    with FileLock(mark.with_suffix(".lock")):
        assert librosa_import.import_librosa().__name__ == "librosa"


def test_the_mark_is_where_numba_writes_if_it_can(tmp_path, monkeypatch):
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    assert librosa_import._mark().parent == tmp_path
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "new" / "folder"))
    assert librosa_import._mark().parent == tmp_path / "new" / "folder"
    (tmp_path / "file").touch()
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file" / "folder"))
    monkeypatch.setattr(librosa_import.tempfile, "gettempdir", lambda: str(tmp_path / "temporary"))
    assert librosa_import._mark().parent == tmp_path / "temporary"


def test_all_that_is_compiled_on_import_is_named():
    (folder,) = map(Path, find_spec("librosa").submodule_search_locations)
    compiled = {
        ".".join(("librosa", *path.relative_to(folder).with_suffix("").parts))
        for path in folder.rglob("*.py")
        if re.search(r"^@(numba\.)?guvectorize", path.read_text(encoding="utf-8"), re.MULTILINE)
    }
    assert compiled == set(librosa_import.COMPILED)


def test_nothing_else_imports_librosa():
    files = list((ROOT / "src" / "dancediff").rglob("*.py"))
    others = [
        path.name
        for path in files
        if re.search(r"^\s*(import|from) librosa\b", path.read_text(encoding="utf-8"), re.MULTILINE)
    ]
    assert len(files) > 100 and others == []
