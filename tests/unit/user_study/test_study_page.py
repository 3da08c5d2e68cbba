"""Blinding: what is drawn, and that the page does not say what only the key says."""

import json
import re
from collections import Counter

import numpy as np
import pytest
from study_dances import hum, write_dances

import dancediff as dd
from dancediff.cli import main
from dancediff.user_study.blinding import blind
from dancediff.user_study.pairs import Pair
from dancediff.user_study.questions import questions_for

NAMES = ("secretsystem", "rivalsystem")


def pairs(count: int, systems=("A", "B")) -> list[Pair]:
    return [Pair(hum(f"song{k}"), (k + 1, -k - 1), systems) for k in range(count)]


@pytest.fixture
def folders(tmp_path):
    songs = ["waltz", "polka", "tango"]
    made = [write_dances(tmp_path / name, songs, first_seed=10 * k) for k, name in enumerate(NAMES)]
    return made, [hum(name) for name in songs]


def test_every_pair_is_shown_once_and_the_key_knows_its_sides():
    given = pairs(9)
    shown = blind(given, np.random.default_rng(0))
    assert sorted(one.pair.song.name for one in shown) == [f"song{k}" for k in range(9)]
    assert len({one.id for one in shown}) == 9
    for one in shown:
        key = one.key()
        first_is_left = one.dances[0] == one.pair.dances[0]
        assert (key["left"] == "A") == first_is_left and {key["left"], key["right"]} == {"A", "B"}


@pytest.mark.parametrize("count", [4, 7])
def test_sides_are_balanced_for_each_opponent(count):
    for seed in range(20):
        both = pairs(count) + pairs(count, ("A", "C"))
        shown = blind(both, np.random.default_rng(seed))
        for against in "BC":
            swapped = [one.swapped for one in shown if against in one.pair.systems]
            assert abs(sum(swapped) - count / 2) <= 0.5


def test_order_and_sides_follow_from_the_generator_and_differ_between_seeds():
    def drawn(seed):
        shown = blind(pairs(12), np.random.default_rng(seed))
        return [(one.id, one.pair.song.name, one.swapped) for one in shown]

    assert drawn(1) == drawn(1)
    assert [one[1:] for one in drawn(1)] != [one[1:] for one in drawn(2)]
    assert [song for _, song, _ in drawn(1)] != [f"song{k}" for k in range(12)]
    for wanted in ("song0", "song7"):  # who knows the song, or the place, learns nothing
        studies = [drawn(seed) for seed in range(40)]
        sides = Counter(swapped for one in studies for _, song, swapped in one if song == wanted)
        first = Counter(one[0][2] for one in studies)
        assert min(sides[True], sides[False], first[True], first[False]) > 8


def test_the_page_does_not_say_who_danced(folders, tmp_path):
    systems, songs = folders
    made = dd.study(*systems, songs=songs, out=tmp_path / "out" / "s.html")
    page = made.page.read_text(encoding="utf-8")
    key = json.loads(made.key.read_text(encoding="utf-8"))
    assert made.key.name == "s.key.json" and made.pairs == 3
    assert not any(name in page for name in NAMES) and str(tmp_path) not in page
    assert str(key["seed"]) not in page and '"seed"' not in page
    shown = json.loads(re.search(r'id="study">(.*?)</script>', page, re.DOTALL)[1])
    assert sorted(shown["pairs"]) == sorted(key["pairs"]) and shown["id"] == key["study"]
    assert shown["least"] == 2  # as long as the dances are
    for id, known in key["pairs"].items():
        pattern = rf'id="pair-{id}">(.*?)</script>'
        facts = json.loads(re.search(pattern, page, re.DOTALL)[1])
        assert facts["title"] == f"{known['song']} · 2 dancers"
        assert [pane["title"] for pane in facts["panes"]] == ["Left", "Right"]
        assert facts["song"].startswith("data:audio/mpeg")
        assert [pane["metrics"] for pane in facts["panes"]] == [[], []]


def test_the_key_tells_the_dances_apart(folders, tmp_path):
    """The first system's dance is on the side where the key says so."""
    from dancediff.motion.motion import Motion
    from dancediff.viz.player import packed

    systems, songs = folders
    made = dd.study(*systems, songs=songs, out=tmp_path / "s.html")
    page, key = made.page.read_text(encoding="utf-8"), json.loads(made.key.read_text())
    for id, known in key["pairs"].items():
        data = re.search(rf'id="pair-{id}">(.*?)</script>', page, re.DOTALL)[1]
        for side, pane in zip(("left", "right"), json.loads(data)["panes"], strict=True):
            motion = Motion.load(tmp_path / known[side] / known["song"] / "dance.npz")
            assert pane["root"] == packed(motion)["root"]


def test_each_page_is_another_study_unless_a_seed_is_given(folders, tmp_path):
    systems, songs = folders

    def key(name, **how):
        made = dd.study(*systems, songs=songs, out=tmp_path / f"{name}.html", **how)
        return json.loads(made.key.read_text())

    assert key("a")["study"] != key("b")["study"]
    assert key("c", seed=4) == key("d", seed=4)


@pytest.mark.parametrize("change", ["dances", "names", "songs", "questions"])
def test_another_study_with_the_same_seed_takes_no_answers_of_the_first(folders, tmp_path, change):
    """Both had the same ids, so that answers to one were credited to the systems of the other."""
    systems, songs = folders
    first = dd.study(*systems, songs=songs, out=tmp_path / "a.html", seed=4)
    how = {"questions": "lodge"} if change == "questions" else {}
    if change == "songs":
        (systems[0] / "tango").rename(systems[0] / "waltz 2")
    else:
        names = NAMES if change != "names" else ("onesystem", "othersystem")
        where, seed = tmp_path / "more", 0 if change != "dances" else 50
        titles = [song.name for song in songs]
        systems = [write_dances(where / name, titles, first_seed=seed + 10 * k)
                   for k, name in enumerate(names)]  # fmt: skip
    other = dd.study(*systems, songs=songs, out=tmp_path / "b.html", seed=4, **how)
    one, two = (json.loads(made.key.read_text()) for made in (first, other))
    assert one["study"] != two["study"] and not one["pairs"].keys() & two["pairs"].keys()


def test_a_key_is_not_replaced(folders, tmp_path, monkeypatch):
    """Without its key nobody could score the answers to the first page."""
    systems, songs = folders
    made = dd.study(*systems, songs=songs, out=tmp_path / "s.html")
    before = made.key.read_text()
    monkeypatch.setattr("dancediff.user_study.make.pairs_of", None)  # refused before any dance
    with pytest.raises(ValueError, match=r"s\.key\.json' is there already.*name another page"):
        dd.study(*systems, songs=songs, out=tmp_path / "s.html")
    assert made.key.read_text() == before


def test_the_page_asks_for_nothing_and_a_name_cannot_become_code(tmp_path):
    song = "<b>&hum"
    folders = [write_dances(tmp_path / name, [song]) for name in "ab"]
    page = dd.study(*folders, songs=[hum(song)], out=tmp_path / "s.html").page.read_text()
    assert "default-src 'none'" in page and 'src="' not in page and "<link" not in page
    assert song not in page and "{{" not in page.split("</style>")[1].split("<script>")[0]


def test_questions_are_those_of_the_papers():
    assert len(questions_for(None, dancers=3)) == 4 and len(questions_for(None, dancers=1)) == 1
    assert len(questions_for("lodge", dancers=3)) == 1
    with pytest.raises(ValueError, match="soloists"):
        questions_for("tcdiffpp", dancers=1)
    with pytest.raises(ValueError, match="questions='edge'"):
        questions_for("edge", dancers=2)


def test_the_command_makes_a_page_and_scores_answers(folders, tmp_path, capsys, monkeypatch):
    systems, songs = folders
    files = [str(song.save(tmp_path / f"{song.name}.wav")) for song in songs]
    monkeypatch.chdir(tmp_path)
    assert main(["study", *map(str, systems), "--songs", *files, "--questions", "lodge"]) == 0
    assert "page: study.html (pairs: 3, questions on each: 1)" in capsys.readouterr().out
    key = json.loads((tmp_path / "study.key.json").read_text())
    answers = [
        {"pair": id, "question": "impression", "choice": side}
        for id, known in key["pairs"].items()
        for side in ("left", "right")
        if known[side] == NAMES[0]
    ]
    file = {"study": key["study"], "rater": "r", "token": "1", "answers": answers}
    (tmp_path / "r.json").write_text(json.dumps(file))
    assert main(["study", "--score", "r.json"]) == 0  # the key lies beside study.html
    out = capsys.readouterr().out
    assert f"{NAMES[0]} over {NAMES[1]}  impression      1.00" in out
    assert main(["study", "--score", "r.json", "study.key.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scores"][0]["rate"]["votes"] == 3
    assert main(["study", str(systems[0]), "--score", "r.json"]) == 2
    assert "leave the systems out" in capsys.readouterr().err
