"""Answers and a key become win rates and agreement."""

import json
import math

import pytest

from dancediff.metrics.preference import wilson_interval
from dancediff.user_study.scores import score_study

KEY = {
    "study": "s1",
    "questions": ["realism", "harmony"],
    "pairs": {
        "p1": {"song": "a", "left": "ours", "right": "edge", "first": "ours"},
        "p2": {"song": "b", "left": "edge", "right": "ours", "first": "ours"},
        "p3": {"song": "a", "left": "gcd", "right": "ours", "first": "ours"},
    },
}


@pytest.fixture
def files(tmp_path):
    """Writes a key and files of answers: for each rater, a side for each pair and question."""
    (tmp_path / "s.key.json").write_text(json.dumps(KEY))

    def write(raters: dict) -> list:
        paths = [tmp_path / "s.key.json"]
        for token, sides in raters.items():
            answers = [
                {"pair": pair, "question": question, "choice": side}
                for (pair, question), side in sides.items()
            ]
            paths.append(tmp_path / f"{token}.json")
            file = {"study": "s1", "rater": "Ada", "token": token, "answers": answers}
            paths[-1].write_text(json.dumps(file))
        return paths

    return write


def test_wins_are_counted_on_whichever_side_a_system_stands(files):
    first = {("p1", "realism"): "left", ("p2", "realism"): "right", ("p3", "realism"): "left"}
    second = {("p1", "realism"): "left", ("p2", "realism"): "left", ("p3", "harmony"): "right"}
    scores = score_study(files({"x": first, "y": second}))
    assert scores.raters == 2 and scores.left == pytest.approx(4 / 6)  # two may be called Ada
    found = {(s.against, s.question): (s.rate.value, s.rate.votes) for s in scores.scores}
    assert found == {
        ("edge", "realism"): (0.75, 4),  # left left is ours, right is ours, left is edge
        ("gcd", "realism"): (0.0, 1),
        ("gcd", "harmony"): (1.0, 1),
    }
    alphas = {(s.against, s.question): s.alpha for s in scores.scores}
    # p1: left left, p2: right left: D_o = (0 + 2) / 4, D_e = 2 · 3 · 1 / (4 · 3)
    assert alphas["edge", "realism"] == pytest.approx(1 - 0.5 / 0.5)
    assert alphas["gcd", "realism"] is None  # one vote agrees with nobody


def test_raters_of_one_mind_agree_though_one_system_always_wins(files):
    ours = {("p1", "realism"): "left", ("p2", "realism"): "right"}
    (score,) = score_study(files({"x": ours, "y": ours, "z": ours})).scores
    assert score.rate.value == 1 and score.alpha == 1
    # two pairs, three raters, six votes: worth 1 / (1/2 + 1/3 - 1/6)
    assert score.rate.effective == pytest.approx(1.5)
    assert score.rate[1:3] == pytest.approx(wilson_interval(1.0, 1.5))


def test_a_file_handed_in_twice_counts_once_and_two_versions_are_refused(files, tmp_path):
    paths = files({"x": {("p1", "realism"): "left"}})
    again = tmp_path / "x (1).json"
    again.write_text(paths[1].read_text())
    assert score_study([*paths, again]).scores[0].rate.votes == 1
    again.write_text(paths[1].read_text().replace('"left"', '"right"'))
    with pytest.raises(ValueError, match=r"x\.json' and .*x \(1\)\.json' are of one rater"):
        score_study([*paths, again])


def test_a_pair_answered_twice_counts_once_and_not_at_all_if_differently(files):
    paths = files({"x": {("p1", "realism"): "left"}})
    file = json.loads(paths[1].read_text())
    (answer,) = file["answers"]
    paths[1].write_text(json.dumps(file | {"answers": [answer] * 3}))
    assert score_study(paths).scores[0].rate.votes == 1
    paths[1].write_text(json.dumps(file | {"answers": [answer, answer | {"choice": "right"}]}))
    with pytest.raises(ValueError, match=r"x\.json' answers 'realism' of pair 'p1' twice"):
        score_study(paths)


def test_the_table_and_the_facts_say_the_same(files):
    scores = score_study(files({"x": {("p1", "realism"): "left", ("p2", "realism"): "left"}}))
    (row,) = scores.facts()["scores"]
    line = next(line for line in str(scores).splitlines() if "realism" in line)
    low, high = row["rate"]["low"], row["rate"]["high"]
    assert line.split() == [
        *("ours", "over", "edge", "realism", "0.50", f"[{low:.2f},", f"{high:.2f}]", "2", "-")
    ]
    assert json.loads(json.dumps(scores.facts())) == scores.facts()  # no nan in it
    assert math.isfinite(low)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('"s1"', '"s2"', "answers study 's2', the key is of 's1'"),
        ('"p1"', '"p9"', "is none to this study"),
        ('"realism"', '"beauty"', "is none to this study"),
        ('"left"', '"middle"', "is none to this study"),
        ('"token"', '"tokens"', "has no 'token'"),
        ('"token": "x"', '"token": ["x"]', "holds no answers of a rater"),
        ('"answers"', '"answers": 5, "more"', "holds no answers of a rater"),
        ('{"study"', '{{"study"', "is no JSON"),
    ],
)
def test_what_does_not_fit_is_refused_by_name(files, old, new, message):
    paths = files({"x": {("p1", "realism"): "left"}})
    paths[1].write_text(paths[1].read_text().replace(old, new))
    with pytest.raises(ValueError, match=rf"x\.json.*{message}"):
        score_study(paths)


def test_no_key_and_no_votes_are_refused(files, tmp_path):
    key, answers = files({"x": {("p1", "realism"): "left"}})
    with pytest.raises(ValueError, match="0 keys"):
        score_study([answers])
    with pytest.raises(ValueError, match="no votes"):
        score_study([key])
    with pytest.raises(ValueError, match="does not exist"):
        score_study([answers], tmp_path / "lost.key.json")
    assert score_study([answers], key).scores[0].rate.value == 1
