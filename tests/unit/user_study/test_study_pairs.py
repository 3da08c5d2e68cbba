"""Which dances are compared with which."""

import pytest
import torch
from study_dances import dance, hum, write_dances

from dancediff import hub
from dancediff.user_study.pairs import pairs_of, songs_named
from tiny_tcdiffpp import tiny_tcdiffpp

SONGS = {name: hum(name) for name in ("waltz", "polka", "tango")}


def test_dances_to_one_song_are_a_pair(tmp_path):
    a = write_dances(tmp_path / "a", ["waltz", "polka"])
    b = write_dances(tmp_path / "b", ["polka", "tango", "waltz"], first_seed=10)
    pairs = pairs_of([a, b], SONGS)
    assert [pair.song.name for pair in pairs] == ["polka", "waltz"]
    assert {pair.systems for pair in pairs} == {("a", "b")}
    first, other = pairs[1].dances
    assert torch.equal(first.root, dance(0).root) and torch.equal(other.root, dance(12).root)


def test_the_first_is_compared_with_each_of_the_others(tmp_path):
    folders = [write_dances(tmp_path / name, ["waltz"], first_seed=ord(name)) for name in "abc"]
    assert [p.systems for p in pairs_of(folders, SONGS)] == [("a", "b"), ("a", "c")]


def test_what_a_dance_says_of_its_song_goes_before_its_name(tmp_path):
    for name in "ab":
        made = dance(1)
        made.meta["song"] = "waltz"
        (tmp_path / name).mkdir()
        made.save(tmp_path / name / "dance.npz")
    (pair,) = pairs_of([tmp_path / "a", tmp_path / "b"], SONGS)
    assert pair.song is SONGS["waltz"]


def test_dances_are_cut_to_what_all_have(tmp_path):
    a = write_dances(tmp_path / "a", ["waltz"], seconds=1.6)
    b = write_dances(tmp_path / "b", ["waltz"])
    (pair,) = pairs_of([a, b], SONGS)
    assert [one.num_frames for one in pair.dances] == [48, 48]
    (pair,) = pairs_of([a, b], SONGS, seconds=1)
    assert [one.num_frames for one in pair.dances] == [30, 30]


def test_a_model_dances_to_the_songs(tmp_path):
    hub.save_model(tiny_tcdiffpp().model, tmp_path / "tiny")
    a = write_dances(tmp_path / "a", ["waltz"], seconds=1)
    (pair,) = pairs_of([tmp_path / "tiny", a], {"waltz": SONGS["waltz"]}, seconds=1, dancers=2)
    assert pair.systems == ("tiny", "a") and pair.dances[0].meta["song"] == "waltz"
    assert pair.dances[0].num_dancers == 2 and pair.dances[0].num_frames == 30


def test_a_model_dances_shorter_songs_to_their_end(tmp_path):
    """At most 2 s of each was an error for a song of 1.5 s."""
    hub.save_model(tiny_tcdiffpp().model, tmp_path / "tiny")
    a = write_dances(tmp_path / "a", ["waltz", "polka"])
    songs = {"waltz": SONGS["waltz"], "polka": hum("polka", 1.5)}
    for seconds, frames in ((2, [45, 60]), (1, [30, 30]), (None, [45, 60])):
        pairs = pairs_of([tmp_path / "tiny", a], songs, seconds=seconds, dancers=2)
        assert [pair.dances[0].num_frames for pair in pairs] == frames  # polka comes first


def test_what_cannot_be_compared_is_refused(tmp_path):
    a = write_dances(tmp_path / "a", ["waltz"])
    b = write_dances(tmp_path / "b", ["polka"])
    c = write_dances(tmp_path / "c", ["waltz"], dancers=3)
    d = write_dances(tmp_path / "x" / "a", ["waltz"])
    with pytest.raises(ValueError, match="1 systems"):
        pairs_of([a], SONGS)
    with pytest.raises(ValueError, match="'a' and 'b' have no song in common: waltz against polka"):
        pairs_of([a, b], SONGS)
    with pytest.raises(ValueError, match="num_dancers=2 of 'a' and 3 of 'c'"):
        pairs_of([a, c], SONGS)
    with pytest.raises(ValueError, match="sound of song 'waltz' is not given"):
        pairs_of([a, d], {})
    with pytest.raises(ValueError, match="seconds=0 must be above 0"):
        pairs_of([a, d], SONGS, seconds=0)
    with pytest.raises(ValueError, match="named twice"):
        pairs_of([a, a], SONGS)
    with pytest.raises(ValueError, match="neither a folder of dances nor a model"):
        pairs_of([a, "nobody"], SONGS)
    with pytest.raises(
        ValueError, match="a system is a Music; give a folder of dances or the name"
    ):
        pairs_of([a, next(iter(SONGS.values()))], SONGS)
    with pytest.raises(ValueError, match="'nobody' is neither"):
        pairs_of(["tcdiffpp", "nobody"], {})  # before the model is asked for its songs
    with pytest.raises(ValueError, match="model 'tcdiffpp' needs songs"):
        pairs_of(["tcdiffpp", a], {})
    assert len({*pairs_of([a, d], SONGS)[0].systems}) == 2  # two folders called a


def test_songs_are_known_by_their_names(tmp_path):
    for name in ("waltz", "polka"):
        hum(name).save(tmp_path / f"{name}.wav")
    assert songs_named([tmp_path, hum("tango")]).keys() == {"waltz", "polka", "tango"}
    assert songs_named("packaged").keys() == {hub.SONG}
    with pytest.raises(ValueError, match="two are called 'waltz'"):
        songs_named([tmp_path, hum("waltz")])
