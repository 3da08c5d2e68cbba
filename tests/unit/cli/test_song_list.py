"""Which dances a list, a folder or a manifest asks for, and what they are called."""

from pathlib import Path

import pytest

from dancediff.cli.options import FIELDS, read_option
from dancediff.cli.song_list import are_many, song_list


def touch(folder: Path, *names: str) -> Path:
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()
    return folder


def names(*words, **options):
    return [row.name for row in song_list([str(word) for word in words], "tcdiffpp", options)]


def manifest(folder: Path, text: str, encoding="utf-8") -> Path:
    path = folder / "list.csv"
    path.write_text(text, encoding=encoding)
    return path


def test_a_folder_means_the_songs_in_it_and_below(tmp_path):
    touch(tmp_path, "b.WAV", "a/b.flac", "a/c.mp3", "a/c.ogg", ".old/d.wav", "notes.txt")
    assert sorted(names(tmp_path)) == ["a/b", "a/c.mp3", "a/c.ogg", "b"]
    assert are_many([str(tmp_path)])


def test_songs_of_one_name_are_told_apart_by_their_folders(tmp_path):
    touch(tmp_path, "a/s.wav", "b/s.wav", "t.wav")
    words = [tmp_path / "a/s.wav", tmp_path / "b/s.wav", tmp_path / "t.wav"]
    assert names(*words) == ["s_a", "s_b", "t"]
    assert names(*words[::-1]) == ["t", "s_b", "s_a"]


def test_a_manifest_asks_for_each_dance_in_its_own_way(tmp_path):
    text = "song,dancers,seconds,seed,genre,swap,model,foot-contact\n"
    text += "s.wav,2,7.5,1,,1 0,,false\npackaged,,,,jazz,,lodge,\n"
    first, second = song_list([str(manifest(tmp_path, text))], "tcdiffpp", {"seed": 4, "steps": 9})
    assert (first.name, first.song, first.model) == ("s", str(tmp_path / "s.wav"), "tcdiffpp")
    assert first.options == {
        "seed": 1, "steps": 9, "dancers": 2, "seconds": 7.5, "swap": (1, 0), "foot_contact": False
    }  # fmt: skip
    assert (second.name, second.song, second.model) == ("packaged", "packaged", "lodge")
    assert second.options == {"seed": 4, "steps": 9, "genre": "jazz"}


def test_names_say_in_what_dances_to_one_song_differ_whatever_their_order(tmp_path):
    rows = ["s.wav,1,2,,", "s.wav,2,2,,", "s.wav,2,3,1 2 0,", "t.wav,,,,", "s.wav,,,,mine/own"]
    wanted = {"s_seed1_dancers2", "s_seed2_dancers2", "s_seed2_dancers3_swap1-2-0", "t", "mine/own"}
    for order in (rows, rows[::-1]):
        text = "\n".join(["song,seed,dancers,swap,name", *order])
        assert set(names(manifest(tmp_path, text))) == wanted


def test_a_table_of_a_german_spreadsheet_is_read(tmp_path):
    path = manifest(tmp_path, 'song;seed\r\n"a;b.wav";3\r\n', "utf-8-sig")
    (row,) = song_list([str(path)], "tcdiffpp", {})
    assert (row.name, row.options) == ("a;b", {"seed": 3})


def test_models_and_songs_lie_beside_the_manifest(tmp_path):
    touch(tmp_path, "mine/config.json", "songs/s.wav")
    path = manifest(tmp_path, "song,model\nsongs/s.wav,mine\nsongs/s.wav,lodge\n")
    rows = song_list([str(path)], "tcdiffpp", {})
    assert [row.name for row in rows] == ["s_mine", "s_lodge"]
    assert rows[0].model == str(tmp_path / "mine") and Path(rows[0].song).is_file()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no column song"),
        ("name\na\n", "no column song"),
        ("song,tempo\na.wav,3\n", "'tempo' is unknown; choose from song"),
        ("song,seed,seed\na.wav,3,3\n", "'seed' is double"),
        ("song\n", "names no song"),
        ("song,seed\n,3\n", "line 2: the cell of song is empty"),
        ("song,seed\na.wav,1\nb.wav,one\n", "line 3: seed 'one': give a whole number"),
        ("song,sampler\na.wav,euler\n", "sampler 'euler': give one of dpm, ddim, ddpm"),
        ("song,foot_contact\na.wav,yes\n", "foot_contact 'yes': give True or False"),
        ("song,swap\na.wav,a b\n", "swap 'a b': give whole numbers"),
        ("song,seed\na.wav,1,2\n", "line 2: it has more or fewer cells"),
        ("song,seed\na.wav\n", "line 2: it has more or fewer cells"),
        ("song,name\na.wav,../up\n", "'../up' is no name for a folder"),
        ("song,name\na.wav,/root\n", "'/root' is no name for a folder"),
        ("song\na.wav\na.wav\n", "2 dances would be called 'a'"),
        ("song,name\na.wav,x\nb.wav,X\n", "2 dances would be called 'x'"),
    ],
)
def test_what_is_wrong_in_a_manifest_is_said_before_any_work(tmp_path, text, words):
    with pytest.raises(ValueError, match=words):
        names(manifest(tmp_path, text))


def test_other_files_are_refused(tmp_path):
    with pytest.raises(ValueError, match="no text in UTF-8"):
        names(manifest(tmp_path, "song\nä.wav\n", "latin-1"))
    with pytest.raises(ValueError, match="holds no wav"):
        names(touch(tmp_path / "hollow", "a.txt"))


@pytest.mark.parametrize("name", FIELDS)
def test_every_option_can_stand_in_a_cell(name):
    """What cannot be meant is refused in words, or left to the request, which knows its limits."""
    try:
        read_option(name, "€")
    except ValueError as err:
        assert str(err).startswith(f"{name} '€': give ") and "another value" not in str(err)


def test_sounds_of_other_formats_are_named(tmp_path):
    touch(tmp_path, "a.wav", "b.aiff", "c/d.M4A", ".old/e.m4a", "notes.txt")
    with pytest.warns(UserWarning, match=r"not read: 2 \(b.aiff, c/d.M4A\); convert them to wav"):
        assert names(tmp_path) == ["a"]


def test_all_segments_at_once_can_be_asked_for_in_a_cell():
    assert read_option("at_once", "None") is None and read_option("at_once", "4") == 4
    with pytest.raises(ValueError, match="dancers 'None': give a whole number"):
        read_option("dancers", "None")
