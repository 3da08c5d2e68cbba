"""Answers are judged again, whatever a notebook says of itself, and whatever they do."""

import csv

import nbformat
import pytest

from dancediff import grading, nb
from dancediff.grading.replay import judge_cells

FURTHER = """
def further(x_s, s, t, abar, eps):
    left = share(abar, s, t)
    return left**power * x_s + torch.sqrt(1 - left) * eps
"""
ANSWERS = {  # exercise, the name that is checked, what the student wrote, the mark
    "04.1": ("x0_from", "def x0_from(x_t, eps, t, abar):\n    return x_t - eps", nb.WRONG),
    "04.2": ("further", FURTHER, nb.RIGHT),
    "04.3": ("drowned", "drowned = {'sway': ..., 'kick': ..., 'tremble': ...}", nb.OPEN),
    "04.4": ("fool", "def fool(eps, abar)\n    return 960, eps", nb.WRONG),
    "04.5": ("my_abar", "import os\nos.abort()", grading.CRASHES),
    "05.2": ("distance_loss", "def distance_loss(p_hat, p):\n    return p_0", nb.WRONG),
    "05.3": ("fool", "def fool(p):\n    while True:\n        pass", grading.HANGS),
    "07.1": ("hear_all", "def hear_all(h):\n    return h + h.mean(1, keepdim=True)", nb.RIGHT),
}


def cell(text, *tags, says=""):
    made = nbformat.v4.new_code_cell(text, metadata={"tags": list(tags)})
    if says:
        made.outputs = [nbformat.v4.new_output("stream", name="stdout", text=says)]
    return made


def handed_in(exercises):
    """A notebook whose stored outputs say that all is right; two answers need its other cells."""
    cells = [
        cell("%matplotlib inline\nimport torch\nslow = [torch.ones(10**9) for _ in range(999)]"),
        cell("def share(abar, s, t):\n    return abar[t] / abar[s]\n\npower = 0.5"),
    ]
    for exercise in exercises:
        name, answer, _ = ANSWERS[exercise]
        cells.append(cell(answer, "exercise"))
        cells.append(cell(f'nb.check("{exercise}", {name})', says=f"✓ {exercise} by hand"))
    return nbformat.v4.new_notebook(cells=cells)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_answers_are_judged_again_whatever_they_do(tmp_path, capsys):
    for student, exercises in (("ann", list(ANSWERS)), ("bob", ["04.2"])):
        (tmp_path / student).mkdir()
        nbformat.write(handed_in(exercises), tmp_path / student / "all.ipynb")
    (tmp_path / "bob" / "05.ipynb").write_text("{", encoding="utf-8")
    table = tmp_path / "marks.csv"
    command = ["grade", str(tmp_path), "--csv", str(table)]
    assert nb.main(command) == 0  # as stored
    assert rows_of(table)["ann"]["right"] == str(len(ANSWERS))
    assert nb.main([*command, "--again", "--seconds", "5"]) == 0
    said = capsys.readouterr().out
    for exercise, (_, _, mark) in ANSWERS.items():
        assert f"{mark} {exercise}" in said
    rows = rows_of(table)
    words = ["wrong", "right", "open", "wrong", "crashes", "wrong", "hangs", "right"]
    assert [rows["ann"][exercise] for exercise in ANSWERS] == words
    assert (rows["ann"]["right"], rows["ann"]["of"]) == ("2", str(len(ANSWERS)))
    assert rows["bob"]["cannot be read"].endswith("05.ipynb") and rows["bob"]["04.1"] == ""


def rows_of(table):
    with table.open(encoding="utf-8-sig", newline="") as file:
        return {row.pop("student"): row for row in csv.DictReader(file)}


def test_the_better_of_two_notebooks_counts():
    rows = [
        {"file": "ann/a.ipynb", "marks": {"04.1": nb.OPEN, "04.2": nb.RIGHT}},
        {"file": "ann/b.ipynb", "marks": {"04.1": nb.WRONG, "04.2": nb.OPEN}},
        {"file": "bob.ipynb", "marks": {"05.1": nb.RIGHT}},
    ]
    assert grading.csv_text(rows).splitlines() == [
        "student,right,of,04.1,04.2,05.1,cannot be read",
        "ann,1,3,wrong,right,,",
        "bob,1,3,,,right,",
    ]


@pytest.mark.parametrize("wrong", [["--seconds", "0"], ["--nonsense"]])
def test_a_wrong_option_is_refused(wrong, tmp_path, capsys):
    with pytest.raises(SystemExit) as stop:
        nb.main(["grade", str(tmp_path), *wrong])
    assert stop.value.code == 2


def judged(*cells):
    """The marks of a notebook, judged in this process."""
    said = judge_cells(nbformat.v4.new_notebook(cells=list(cells)), [])
    return {exercise: mark for exercise, mark in said if mark is not None}


RIGHT_LOSS = nb.solution_text("05.2")
CHECK = 'nb.check("05.2", distance_loss)'


@pytest.mark.parametrize(
    "answer",
    [
        RIGHT_LOSS + "\ndistance_loss(nothing_like_it)",  # it only tries the answer
        RIGHT_LOSS + "\ntried = distance_loss(nothing_like_it)",
        RIGHT_LOSS + "\n%time 3\n!ls",
        "seven = (1007\n  % 1000)\nassert seven == 7\n" + RIGHT_LOSS,
        "%time 3\nseven = (1007\n  % 1000)\n" + RIGHT_LOSS,
    ],
)
def test_an_answer_is_right_whatever_stands_around_it(answer):
    assert judged(cell(answer, "exercise"), cell(CHECK)) == {"05.2": nb.RIGHT}


def test_a_name_that_could_not_be_defined_is_wrong():
    """Though an earlier cell gave it a value."""
    before = cell(RIGHT_LOSS, "exercise")
    for answer in ("distance_loss = nothing_like_it", "distance_loss = (", "def distance_loss("):
        assert judged(before, cell(answer, "exercise"), cell(CHECK)) == {"05.2": nb.WRONG}
    again = cell(RIGHT_LOSS, "exercise")
    assert judged(cell("distance_loss = (", "exercise"), again, cell(CHECK)) == {"05.2": nb.RIGHT}


def test_stub_and_check_may_share_a_cell_and_checks_too():
    loss, hears = RIGHT_LOSS, ANSWERS["07.1"][1]
    assert judged(cell(f"{loss}\n{CHECK}", "exercise")) == {"05.2": nb.RIGHT}
    assert judged(cell(f"import torch\n{loss}\n{CHECK}")) == {"05.2": nb.RIGHT}
    both = cell(f'{loss}\n{hears}\n{CHECK}\nnb.check("07.1", hear_all)', "exercise")
    assert judged(both) == {"05.2": nb.RIGHT, "07.1": nb.RIGHT}
