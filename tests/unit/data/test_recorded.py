"""Recorded songs become takes: any format, subfolders, manifests, bad files, splits by title."""

import json

import numpy as np
import pytest
import torch

from dancediff.cli import main
from dancediff.data.cache import use_cache
from dancediff.data.choreographed import any_genre
from dancediff.data.packed import PackedTakes
from dancediff.data.prepare import prepare, recipe
from dancediff.data.prepared import NAME, PreparedData
from dancediff.data.recorded import song_jobs
from dancediff.data.song_folder import songs_in
from dancediff.data.windows import GroupCut, WindowSampler
from dancediff.music.energy import energy_curve, song_loudness
from dancediff.music.features import beat_times
from dancediff.music.song import Music
from dancediff.music.synth import synth_song


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two songs of 9 s as ogg and wav, one that is silent, one too short, one that is no sound."""
    folder = tmp_path_factory.mktemp("songs")
    (folder / "deep" / "er").mkdir(parents=True)
    synth_song(1, seconds=9)[0].save(folder / "one.ogg")
    synth_song(2, seconds=9)[0].save(folder / "deep" / "er" / "Two!.wav")
    Music(np.zeros(22050 * 8, dtype=np.float32), 22050).save(folder / "deep" / "silent.wav")
    synth_song(3, seconds=3)[0].save(folder / "short.wav")
    (folder / "broken.mp3").write_bytes(b"no sound")
    (folder / "deep" / "er" / "copyright").write_text("CC0\n")
    (folder / "songs.toml").write_text(
        '[[song]]\nfile = "one.ogg"\ntitle = "Song One"\nauthor = "A. B."\nlicence = "CC-BY-4.0"\n'
    )
    return folder


def test_every_song_is_danced_and_bad_ones_are_named(folder, tmp_path):
    jobs = song_jobs(folder, dances_per_song=3, seconds=7)
    summary = prepare(jobs, tmp_path, progress=False)
    assert (summary.made, len(summary.skipped)) == (6, 9)
    reasons = " ".join(summary.skipped.values())
    assert "is silent" in reasons and "lasts 3.0 s" in reasons and "cannot be read" in reasons
    data = PreparedData(tmp_path)
    assert [entry.dancers for entry in data if "song-one" in entry.name] == [1, 2, 3]
    assert {(entry.kind, entry.music, entry.frames) for entry in data} == {
        ("synthetic", "recorded", 210)
    }
    again = prepare(song_jobs(folder, dances_per_song=3, seconds=7), tmp_path, progress=False)
    assert (again.made, again.kept, len(again.skipped)) == (0, 6, 9)


def test_a_part_has_the_features_of_the_whole_song(folder):
    jobs = song_jobs(folder, dances_per_song=6, seconds=7)
    first, *others = (job.make() for job in jobs if "one" in job.name)
    second = next(take for take in others if take.notes["start"] > 0)
    M = Music.load(folder / "one.ogg").features()
    assert torch.equal(first.M, M[:210]) and first.notes["start"] == 0
    start = round(second.notes["start"] * 30)
    assert start > 0 and torch.equal(second.M, M[start : start + 210])
    assert np.allclose(
        second.beats, beat_times(M[: start + 210])[-len(second.beats) :] - start / 30
    )


def test_genres_that_do_not_suit_a_song_are_danced_too(folder):
    jobs = [job for job in song_jobs(folder, dances_per_song=8) if "song-one" in job.name]
    takes = [job.make() for job in jobs]
    asked = [any_genre(take.notes["seed"]) for take in takes]
    assert any(asked) and None in asked
    assert all(take.genre == name for take, name in zip(takes, asked, strict=True) if name)


def test_a_song_shorter_than_a_part_is_danced_whole(folder):
    take = next(job for job in song_jobs(folder) if "song-one" in job.name).make()
    assert take.num_frames == Music.load(folder / "one.ogg").num_frames


def test_where_a_song_is_from(folder):
    songs = {song.path.name: song for song in songs_in(folder, licence="mine")}
    one, two = songs["one.ogg"], songs["Two!.wav"]
    assert (one.title, one.author, one.licence) == ("Song One", "A. B.", "CC-BY-4.0")
    assert (two.title, two.author, two.licence) == ("Two!", "unknown", "mine")
    assert songs_in(folder)[0].licence == "unknown"
    assert {s.path.name: s.licence for s in songs_in(folder)}["Two!.wav"] == "see copyright"
    take = next(job for job in song_jobs(folder, seconds=6) if "song-one" in job.name).make()
    assert "'Song One' by A. B." in take.source and take.licence == "CC-BY-4.0"


def test_a_folder_may_be_moved_but_a_song_not_changed(tmp_path):
    song = synth_song(4, seconds=7)[0]
    for place in ("here", "there"):
        (tmp_path / place).mkdir()
        song.save(tmp_path / place / "tune.wav")
    here, there = (song_jobs(tmp_path / place)[0] for place in ("here", "there"))
    assert here.name == there.name and recipe(here) == recipe(there)
    song.slice(0, 6.5).save(tmp_path / "there" / "tune.wav")
    assert recipe(here) != recipe(there)


def test_recordings_of_one_title_stay_together(tmp_path):
    song = synth_song(4, seconds=7)[0]
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        song.save(tmp_path / name / "Tune.wav")
    takes = [job.make() for job in song_jobs(tmp_path, dances_per_song=1, seconds=6, share=0.5)]
    assert len({take.name for take in takes}) == 2
    assert len({(take.group, take.split) for take in takes}) == 1


def test_one_file_under_two_names_is_one_song(tmp_path):
    """It was in train by one name and in val by the other."""
    for name, sound in (("One", b"x"), ("Two", b"x"), ("two!", b"y"), ("Three", b"z")):
        (tmp_path / f"{name}.wav").write_bytes(sound)
    jobs = song_jobs(tmp_path, dances_per_song=1)
    keys = {job.make.args[0].path.stem: job.make.keywords["key"] for job in jobs}
    assert keys == {"One": "one", "Two": "one", "two!": "one", "Three": "three"}


def test_changed_versions_of_a_song_are_danced_to(folder, tmp_path):
    jobs = [
        j for j in song_jobs(folder, dances_per_song=2, augment=2, seconds=6) if "one" in j.name
    ]
    assert len(jobs) == 6
    with use_cache(tmp_path):
        takes = [job.make() for job in jobs]
        assert all(torch.equal(job.make().M, t.M) for job, t in zip(jobs, takes, strict=True))
    assert len(list(tmp_path.glob("*.npy"))) == 6  # features and words of three versions
    assert [bool(take.notes["augmented"]) for take in takes] == 2 * [False] + 4 * [True]
    assert not torch.equal(takes[0].M, takes[2].M) and len({take.split for take in takes}) == 1
    plain = next(job for job in song_jobs(folder, seconds=6) if job.name == jobs[0].name)
    assert torch.equal(plain.make().M, takes[0].M)


def test_songs_from_the_command_line(folder, tmp_path, capsys):
    args = ["prepare", "songs", str(folder), str(tmp_path / "out"), "--seconds", "6"]
    assert main([*args, "--dances-per-song", "1", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["made"] == 2 and {row["music"] for row in facts["takes"]} == {"recorded"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"dances_per_song": 0}, "dances_per_song=0"),
        ({"augment": -1}, "augment=-1"),
        ({"seconds": 2}, "seconds=2"),
        ({"share": 1}, "share=1"),
    ],
)
def test_bad_arguments_are_named(folder, options, words):
    with pytest.raises(ValueError, match=words):
        song_jobs(folder, **options)


def test_bad_manifests_are_named(tmp_path):
    synth_song(1, seconds=6)[0].save(tmp_path / "a.wav")
    for text in ("[[song]]\n", "song = 3\n", "no toml", '[[song]]\nfile = "b.wav"\n'):
        (tmp_path / "songs.toml").write_text(text)
        with pytest.raises(ValueError, match=r"songs\.toml"):
            songs_in(tmp_path)


def test_windows_hear_a_part_as_loud_as_it_is_in_its_song(folder):
    """A network gets the energy that the choreographer followed, not that of the part alone."""
    jobs = song_jobs(folder, dances_per_song=6, seconds=7)
    takes = [job.make() for job in jobs if "one" in job.name]
    take = next(take for take in takes if take.notes["start"] > 0)
    M = Music.load(folder / "one.ogg").features()
    start = round(take.notes["start"] * 30)
    heard = WindowSampler([take], GroupCut(150), energy=True).energy(take, 0)
    inner = slice(30, -30)  # at its ends a part is smoothed over fewer frames
    assert torch.allclose(heard[inner], energy_curve(M)[start : start + 210][inner], atol=1e-6)
    assert take.loudness == song_loudness(M)


def test_the_loudness_of_the_song_is_kept(folder, tmp_path):
    prepare(song_jobs(folder, dances_per_song=1, seconds=7), tmp_path, progress=False)
    for take in PackedTakes(tmp_path).takes() + PackedTakes(tmp_path, "val").takes():
        assert take.loudness is not None
        assert PreparedData(tmp_path).load(take.name).loudness == take.loudness


def test_titles_of_any_alphabet_are_told_apart(tmp_path):
    titles = ("ワルツ", "Вальс", "Café", "The Waltz", "?")
    for title in titles:
        (tmp_path / f"{title}.ogg").touch()
    (tmp_path / "._The Waltz.ogg").touch()  # what macOS puts beside it
    keys = {song.title: song.key for song in songs_in(tmp_path)}
    assert keys == dict(zip(titles, ("ワルツ", "вальс", "café", "the-waltz", "song"), strict=True))
    names = [job.name for job in song_jobs(tmp_path, dances_per_song=1)]
    assert len(set(names)) == 5 and all(NAME.fullmatch(name) for name in names)
    assert sum(name.startswith("song_the-waltz_") for name in names) == 1


def test_a_manifest_with_a_mark_is_read(tmp_path):
    (tmp_path / "a.ogg").touch()
    text = '[[song]]\nfile = "a.ogg"\ntitle = "A"\n'
    (tmp_path / "songs.toml").write_text(text, encoding="utf-8-sig")
    assert songs_in(tmp_path)[0].title == "A"
