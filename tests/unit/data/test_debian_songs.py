"""The script that collects songs: origins, what is left out, and a folder that can be prepared."""

import runpy
import zipfile
from pathlib import Path

import pytest
from numpy.testing import assert_allclose

from dancediff.data.song_folder import songs_in
from dancediff.music.song import Music
from dancediff.music.synth import synth_song
from places import DATA_PREP

COPYRIGHT = """Format: https://www.debian.org/doc/packaging-manuals/copyright-format/1.0/

Files: *
Copyright: 2001-2009, The Team <team@example.org>
License: GPL-2+
 Some text.

Files: base/music/second.ogg
 base/other/third.ogg
Copyright:
 2010 Ann Other (www.example.org)
 B. C.
License: CC-BY-3.0
"""


@pytest.fixture(scope="module")
def script():
    return runpy.run_path(str(DATA_PREP / "debian_songs.py"), run_name="script")


@pytest.fixture(scope="module")
def share(tmp_path_factory):
    """A package as it lies unpacked: four songs, one of them short, and an archive."""
    share = tmp_path_factory.mktemp("share")
    (share / "doc" / "tunes").mkdir(parents=True)
    (share / "doc" / "tunes" / "copyright").write_text(COPYRIGHT)
    music = share / "games" / "music"
    music.mkdir(parents=True)
    song = synth_song(1, seconds=21)[0]
    for name, seconds in (("first", 21), ("second", 21), ("jingle", 5)):
        song.slice(0, seconds).save(music / f"{name}.ogg")
    synth_song(2, seconds=21)[0].save(music / "Tested.ogg")
    with zipfile.ZipFile(music / "more.pk3", "w") as archive:
        archive.write(music / "first.ogg", "sound/inner.ogg")
    with zipfile.ZipFile(music / "more.pk3") as archive:
        archive.extractall(music / "more.files")
    return share


def test_stanzas_name_author_and_licence(script):
    assert script["stanzas"](COPYRIGHT) == [
        (["*"], "The Team", "GPL-2+"),
        (["base/music/second.ogg", "base/other/third.ogg"],
         "Ann Other (www.example.org), B. C.", "CC-BY-3.0"),
    ]  # fmt: skip


def test_songs_are_collected_with_their_origin(script, share, tmp_path):
    package = script["Package"]("tunes", "games/music/*.ogg")
    never = {"tested"}
    rows = [row for row, _ in script["collect"](package, tmp_path, share, {}, never)]
    assert [(row["title"], row["licence"]) for row in rows] == [
        ("first (tunes)", "GPL-2+"), ("second (tunes)", "CC-BY-3.0")
    ]  # fmt: skip
    assert {row["author"] for row in rows} == {"The Team", "Ann Other (www.example.org), B. C."}
    assert {song.path.name for song in songs_in(tmp_path)} == {"first.ogg", "second.ogg"}


def test_archives_are_looked_into(script, share):
    package = script["Package"]("tunes", "games/music/*.pk3")
    assert [path.name for path in script["files_of"](package, share)] == ["inner.ogg"]


def test_songs_that_models_are_tested_on_are_known(script, share):
    known = script["known"]([share / "games"])
    assert {"first", "tested", "inner"} <= known and len([k for k in known if len(k) == 64]) == 4


def test_guitar_and_band_are_played_together(script, tmp_path):
    for name, seed in (("song", 1), ("guitar", 2)):
        synth_song(seed, seconds=3)[0].save(tmp_path / f"{name}.ogg")
    music = script["whole"](tmp_path / "song.ogg")
    band, guitar = (Music.load(tmp_path / f"{name}.ogg").audio for name in ("song", "guitar"))
    assert music.name == Path(tmp_path).name
    assert_allclose(music.audio, 0.5 * (band + guitar), atol=1e-6)


def test_a_folder_to_leave_out_that_is_not_there_is_named(script, tmp_path):
    with pytest.raises(ValueError, match=r"--exclude '.*nowhere' is no folder"):
        script["known"]([tmp_path / "nowhere"])
