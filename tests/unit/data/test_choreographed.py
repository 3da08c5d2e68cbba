"""Synthetic takes as jobs: all from seeds, songs made once, splits by song."""

from collections import Counter
from dataclasses import replace

import numpy as np
import pytest
import torch

from dancediff.data import choreographed as module
from dancediff.data.choreographed import (
    any_genre,
    choreograph_jobs,
    choreographed_corpus,
    choreographed_takes,
    genre_and_tempo,
    make_choreographed,
    synthetic_song,
)
from dancediff.data.packed import PackedTakes
from dancediff.data.prepare import prepare
from dancediff.data.prepared import PreparedData
from dancediff.genre import TEMPOS
from dancediff.music.song_plan import draw_plan
from places import DATA_PREP


def test_a_take_follows_from_its_seed_and_fits_its_song():
    first, again = (choreograph_jobs(3, seconds=6, seed=4)[1].make() for _ in range(2))
    assert torch.equal(first.motion.root, again.motion.root) and torch.equal(first.M, again.M)
    other = choreograph_jobs(3, seconds=6, seed=5)[1].make()
    assert not torch.equal(first.motion.root, other.motion.root)
    assert first.motion.num_dancers == 2 and first.motion.num_frames == len(first.M) == 180
    assert (first.kind, first.music, first.group) == ("synthetic", "synthetic", "synth-4")
    gaps = torch.tensor(first.beats).diff()
    assert torch.allclose(60 / gaps, torch.full_like(gaps, first.notes["tempo"]), rtol=1e-3)
    assert first.beats[-1] < 6 and first.genre == genre_and_tempo(4)[0]


@pytest.mark.parametrize("num", [1, 4, 5, 12, 15])
@pytest.mark.parametrize("repeats", [1, 3])
def test_there_are_as_many_as_asked_for(num, repeats):
    jobs = choreograph_jobs(num, repeats=repeats)
    assert len({job.name for job in jobs}) == len(jobs) == num
    few, more = ({job.name for job in choreograph_jobs(k, repeats=repeats)} for k in (num, num + 7))
    assert few <= more  # more takes are more of the same


def test_a_second_dance_to_a_song_is_another_dance_to_the_same_song():
    jobs = {job.name: job for job in choreograph_jobs(4, seconds=5, sizes=(2, 3), repeats=2)}
    first, second = (jobs[f"choreographed_000000_2{letter}"].make() for letter in ("", "b"))
    assert torch.equal(first.M, second.M) and first.group == second.group
    assert (first.motion.root - second.motion.root).abs().max() > 0.1


def test_dances_to_one_song_stay_together():
    songs: dict[str, set] = {}
    for job in choreograph_jobs(400, sizes=(1, 2)):
        song = job.name.split("_")[1]
        songs.setdefault(song, set()).add(job.make.keywords["share"])
    assert len(songs) == 200
    takes = [job.make() for job in choreograph_jobs(24, seconds=5, sizes=(1, 2), share=0.4)]
    sides = {}
    for take in takes:
        sides.setdefault(take.group, set()).add(take.split)
    assert all(len(side) == 1 for side in sides.values())
    assert Counter(take.split for take in takes)["val"] in range(4, 17)


def test_genres_take_turns():
    names = [genre_and_tempo(k)[0] for k in range(20)]
    assert len(set(names)) >= 8 and names[:10] == names[10:]
    for k in range(20):
        name, tempo = genre_and_tempo(k)
        low, high = TEMPOS[name]
        assert low <= tempo <= high or tempo in (60, 200)


def test_half_of_the_dances_to_varied_songs_are_in_any_genre():
    """Not all of them: else nothing would tell which genre suits a song."""
    drawn = [any_genre(seed) for seed in range(2000)]
    known = Counter(drawn)
    assert 900 < known.pop(None) < 1100
    assert set(known) == set(TEMPOS) and min(known.values()) > 60
    song = replace(synthetic_song(0, 5.0), varied=True)
    takes = [song.danced_by(n) for n in (1, 2, 3, 4, 5)]
    asked = [any_genre(take.notes["seed"]) or song.genre for take in takes]
    assert [take.genre for take in takes] == asked and len(set(asked)) > 1
    plain = replace(song, varied=False)
    assert {plain.danced_by(n).genre for n in (1, 2, 3)} == {song.genre}


def test_a_song_is_rendered_once_for_all_sizes(tmp_path, monkeypatch):
    rendered, synth = [], module.synth_song
    monkeypatch.setattr(
        module, "synth_song", lambda seed, **o: (rendered.append(seed), synth(seed, **o))[1]
    )
    prepare(choreograph_jobs(4, seconds=5, sizes=(1, 2)), tmp_path, progress=False)
    assert sorted(rendered) == [0, 1]
    a, b = (PreparedData(tmp_path).load(f"choreographed_000001_{n}") for n in (1, 2))
    assert torch.equal(a.M, b.M)
    made = synthetic_song(1, 5.0)
    song, truth = synth(1, seconds=5.0, tempo=genre_and_tempo(1)[1])
    assert torch.equal(made.M[:150], a.M) and torch.equal(made.M, song.features())
    assert made.beats.tolist() == truth.beats.tolist() and made.sections == truth.sections


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"num": 0}, "num=0"),
        ({"num": 3, "seconds": 2}, "seconds=2"),
        ({"num": 3, "seed": -1}, "seed=-1"),
        ({"num": 3, "share": 1}, "share=1"),
        ({"num": 3, "sizes": (1, 9)}, r"sizes=\(1, 9\)"),
        ({"num": 3, "repeats": 0}, "repeats=0"),
    ],
)
def test_bad_arguments_are_named(options, words):
    num = options.pop("num")
    with pytest.raises(ValueError, match=words):
        choreograph_jobs(num, **options)


def test_the_script_shows_its_steps(tmp_path, capsys, monkeypatch):
    import runpy
    import sys

    script = DATA_PREP / "choreograph.py"
    monkeypatch.setattr(sys, "argv", [str(script), "2", str(tmp_path), "--seconds", "6"])
    runpy.run_path(str(script), run_name="__main__")
    out = capsys.readouterr().out
    assert "beats a minute" in out and "formations" in out and "made 2" in out
    assert len(PreparedData(tmp_path)) == 2


def same(a, b):
    return all(
        (p.name, p.group, p.genre) == (q.name, q.group, q.genre)
        and torch.allclose(p.x, q.x, atol=1e-6)  # files hold rotations, not vectors
        and torch.equal(p.M, q.M)
        for p, q in zip(a, b, strict=True)
    )


def test_training_without_data_learns_from_what_prepare_makes(tmp_path):
    """With or without a folder: the same songs, the same dances."""
    jobs = choreograph_jobs(4, seconds=6, seed=7, sizes=(1, 3), share=0.0)
    prepare(jobs, tmp_path, progress=False)
    prepared = {take.name: take for take in PackedTakes(tmp_path).takes()}
    corpus = choreographed_corpus(range(7, 9), seconds=6.0, sizes=(1, 3), workers=1)
    assert len(corpus) == len(prepared) == 4
    assert same(corpus, [prepared[take.name] for take in corpus])


def test_a_corpus_on_disk_makes_only_what_is_missing(tmp_path, monkeypatch):
    options = {"seconds": 6.0, "sizes": (2, 1), "workers": 1}
    plain = choreographed_corpus([4, 2], **options)
    assert [t.num_dancers for t in plain] == 2 * [2, 1]
    assert same(plain[:2], choreographed_takes(4, seconds=6.0, sizes=(2, 1)))
    assert same(plain, choreographed_corpus([4, 2], **options, cache=tmp_path))
    (tmp_path / "takes" / "choreographed_000002_1.npz").write_bytes(b"half a file")
    made, make = [], module.choreograph

    def counted(*args, seed, **more):
        made.append(seed)
        return make(*args, seed=seed, **more)

    monkeypatch.setattr(module, "choreograph", counted)
    again = choreographed_corpus([2, 4, 7], **options, cache=tmp_path)
    assert same(plain, again[2:4] + again[:2]) and made == [21, 72, 71]
    again[0].x.add_(1.0)  # what was read may be changed, the files never are
    assert same(plain[2:], choreographed_corpus([2], **options, cache=tmp_path))


def test_a_song_without_a_dance_is_named(tmp_path, monkeypatch):
    def refuse(*args, **options):
        raise ValueError("no dance was found")

    monkeypatch.setattr(module, "choreograph", refuse)
    with pytest.raises(ValueError, match=r"choreographed_000001_2: .*no dance"):
        choreographed_corpus([1], seconds=6.0, sizes=(2,), workers=1, cache=tmp_path)


def test_varied_songs_are_danced_too():
    """Where the music has no beat the take has none, and people are slower than elsewhere."""
    jobs = choreograph_jobs(24, seconds=20, sizes=(1,), varied=True)
    seeds = [job.make.args[0] for job in jobs if draw_plan(job.make.args[0], seconds=20).traits]
    takes = {seed: make_choreographed(seed, 2, seconds=20.0, varied=True) for seed in seeds[:10]}
    still, quick = [], []
    for seed, take in takes.items():
        plan = draw_plan(seed, seconds=20, tempo=genre_and_tempo(seed)[1])
        assert np.allclose(take.beats, plan.beats) and take.notes["meter"] == plan.meter
        speed = take.motion.joints().diff(dim=1).norm(dim=-1).mean((0, 2)) * 30
        for part in plan.sections:
            inside = speed[round(part.start * 30) + 10 : round(part.stop * 30) - 10]
            if len(inside) > 60:
                (quick if len(part.beats) else still).append(float(inside.mean()))
    assert len(still) >= 3 and np.mean(still) < 0.85 * np.mean(quick)
    assert not torch.equal(takes[seeds[0]].M, make_choreographed(seeds[0], 2, seconds=20.0).M)


def test_simple_and_varied_corpora_are_kept_apart(tmp_path):
    options = {"seconds": 6.0, "sizes": (1,), "workers": 1, "cache": tmp_path}
    simple, varied, again = (
        choreographed_corpus([3], **options, varied=varied)[0] for varied in (False, True, False)
    )
    assert torch.equal(simple.M, again.M) and not torch.equal(simple.M, varied.M)


@pytest.mark.slow
def test_several_processes_make_the_same_corpus():
    one = choreographed_corpus([0, 1], seconds=6.0, sizes=(1, 2), workers=1)
    two = choreographed_corpus([0, 1], seconds=6.0, sizes=(1, 2), workers=2)
    for a, b in zip(one, two, strict=True):
        assert a.name == b.name
        torch.testing.assert_close(a.x, b.x, rtol=1e-4, atol=1e-4)
        torch.testing.assert_close(a.M, b.M, rtol=1e-4, atol=1e-3)


@pytest.mark.parametrize(("songs", "shown"), [(2, False), (4, True)])
def test_many_songs_show_their_progress(songs, shown, capsys):
    choreographed_corpus(range(songs), seconds=3.0, sizes=(1,), workers=1)
    assert ("composing songs" in capsys.readouterr().err) == shown
