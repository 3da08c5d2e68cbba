"""The feature cache: found by content, never by name, and never half written."""

import numpy as np
import pytest
import torch

from dancediff.data import cache as module
from dancediff.data.cache import cached, code_digest, content_key, song_features, use_cache
from dancediff.music.song import Music


def song(seed=0, name="song"):
    rng = np.random.default_rng(seed)
    return Music(0.1 * rng.normal(size=15360).astype(np.float32), 15360, name)


@pytest.fixture
def counted(monkeypatch):
    calls, features = [], Music.features

    def count(self):
        calls.append(self.name)
        return features(self)

    monkeypatch.setattr(Music, "features", count)
    return calls


def test_the_same_sound_is_found_under_another_name(tmp_path, counted):
    with use_cache(tmp_path):
        first, again = song_features(song(name="a")), song_features(song(name="b"))
        other = song_features(song(1, name="a"))
    assert counted == ["a", "a"]
    assert torch.equal(first, again) and not torch.equal(first, other)
    assert torch.equal(first, song().features())
    assert len(list(tmp_path.iterdir())) == 2


def test_without_a_folder_nothing_is_kept(tmp_path, counted, monkeypatch):
    monkeypatch.chdir(tmp_path)
    song_features(song())
    song_features(song())
    with use_cache(tmp_path / "cache"), use_cache(None):
        song_features(song())
    assert len(counted) == 3 and not list(tmp_path.iterdir())


def test_a_damaged_file_is_made_anew(tmp_path, counted):
    with use_cache(tmp_path):
        first = song_features(song())
        (path,) = tmp_path.iterdir()
        for damage in (path.read_bytes()[:-9], b"", b"nonsense"):
            path.write_bytes(damage)
            assert torch.equal(song_features(song()), first)
    assert len(counted) == 4 and [p.name for p in tmp_path.iterdir()] == [path.name]


def test_a_failure_leaves_nothing(tmp_path, monkeypatch):
    def full(file, array, **_):
        file.write(b"half")
        raise OSError("no space")

    monkeypatch.setattr(np, "save", full)
    with use_cache(tmp_path):  # the array itself is fine
        assert cached("key", lambda: np.ones(3)).tolist() == [1, 1, 1]
    assert not list(tmp_path.iterdir())


def test_features_of_another_version_are_not_used(tmp_path, counted, monkeypatch):
    with use_cache(tmp_path):
        song_features(song())
        monkeypatch.setattr(module, "code_digest", lambda packages: "another version")
        song_features(song())
    assert len(counted) == 2


def test_keys_tell_parts_apart():
    parts = [
        ("ab", "c"), ("a", "bc"), ("abc",), (1,), ("1",), (b"1",), (1.0,),
        (np.zeros(4),), (np.zeros((2, 2)),), (np.zeros(4, dtype=np.float32),), (np.zeros(8),),
    ]  # fmt: skip
    assert len({content_key(*part) for part in parts}) == len(parts)
    assert content_key(np.arange(4)[::2]) == content_key(np.array([0, 2]))
    assert len(code_digest()) == 16 and code_digest() != code_digest(("music",))


def test_versions_differ_in_code_and_in_tables(tmp_path, monkeypatch):
    monkeypatch.setattr(module, "__file__", str(tmp_path / "data" / "cache.py"))
    (tmp_path / "music").mkdir()
    found = set()
    for name, text in (("a.py", "1"), ("a.py", "2"), ("b.toml", "1"), ("b.toml", "2")):
        (tmp_path / "music" / name).write_text(text)
        found.add(code_digest.__wrapped__(("music",)))
    assert len(found) == 4
