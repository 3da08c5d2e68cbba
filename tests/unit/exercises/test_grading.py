"""Marks come from executed notebooks: solutions all right, stubs all open."""

import io
import json

import nbformat
import pytest

from dancediff import grading, nb
from places import BOOKS

LESSONS = sorted(BOOKS.glob("*.ipynb"))


def only_exercises(solved: bool):
    """One notebook with the stubs (or solutions) and checks of all lessons."""
    cells = [nbformat.v4.new_code_cell("from dancediff import nb")]
    for path in LESSONS:
        book = nbformat.read(path, 4)
        book = grading.with_solutions(book) if solved else book
        tags = [set(c["metadata"].get("tags", [])) for c in book.cells]
        cells += [c for c, t in zip(book.cells, tags, strict=True) if t & {"exercise", "check"}]
    for k, cell in enumerate(cells):
        cell.id = f"c{k}"  # lessons use the same ones
    return nbformat.v4.new_notebook(cells=cells)


def executed(book):
    """As nbclient does it, without a kernel: what a check prints becomes its output."""
    space: dict = {}
    for cell in book.cells:
        with pytest.MonkeyPatch.context() as patch:
            said: list[str] = []
            patch.setattr(nb, "_say", said.append)
            exec(cell.source, space)
        text = "\n".join(said) + "\n"
        cell.outputs = [nbformat.v4.new_output("stream", name="stdout", text=text)] if said else []
    return book


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("class")
    for name, solved in (("ann", True), ("bob", False)):
        (folder / name).mkdir()
        nbformat.write(executed(only_exercises(solved)), folder / name / "all.ipynb")
    return folder


def test_solutions_are_right_and_stubs_open(folder):
    ann, bob = grading.grade(folder)
    assert ann["file"].startswith("ann")
    assert set(ann["marks"]) == set(bob["marks"]) == set(nb.EXERCISES)
    assert set(ann["marks"].values()) == {nb.RIGHT}
    assert set(bob["marks"].values()) == {nb.OPEN}


def test_the_command_prints_it(folder, capsys):
    assert nb.main(["grade", str(folder)]) == 0
    out = capsys.readouterr().out
    count = len(nb.EXERCISES)
    assert f"{count} of {count}" in out and f"0 of {count}" in out
    assert "04.1  solved in 1 of 2  undo the noise" in out
    assert nb.main(["grade", str(folder / "nobody")]) == 2
    assert "there is no folder" in capsys.readouterr().err
    assert nb.main([]) == 2


def test_the_course_as_it_is_is_open():
    for path in LESSONS:
        marks = grading.marks(json.loads(path.read_text(encoding="utf-8")))
        assert marks and set(marks.values()) == {nb.OPEN}, path.stem


def test_a_damaged_file_is_named_and_does_not_stop_the_others(folder, tmp_path):
    for name in ("a.ipynb", "b.ipynb"):
        (tmp_path / name).write_text((folder / "ann" / "all.ipynb").read_text(encoding="utf-8"))
    (tmp_path / "b.ipynb").write_text("{")
    good, bad = grading.grade(tmp_path)
    assert good["marks"]["04.1"] == nb.RIGHT and "failed" in bad
    assert "b.ipynb  cannot be read" in grading.table([good, bad])


def test_a_check_that_was_not_run_has_no_mark():
    cell = {"cell_type": "code", "source": ["nb.check('04.1', x0_from)"], "outputs": []}
    assert grading.marks({"cells": [cell]}) == {"04.1": grading.NOT_RUN}


def checked(source, *said):
    outputs = [{"output_type": "stream", "text": text} for text in said]
    return {"cell_type": "code", "source": source, "outputs": outputs}


@pytest.mark.parametrize(
    ("said", "mark"),
    [
        (["trying\n", "✓ 04.1 right\n"], nb.RIGHT),  # the cell printed something of its own
        (["✗ 04.1 wrong\n✓ 04.1 right\n"], nb.RIGHT),  # the last one counts
        (["✓ 04.2 of another exercise\n"], grading.NOT_RUN),
        (["✓ I think so"], grading.NOT_RUN),
    ],
)
def test_the_mark_is_what_the_check_of_that_exercise_said(said, mark):
    cell = checked('nb.check("04.1", x0_from)', *said)
    assert grading.marks({"cells": [cell]}) == {"04.1": mark}


def test_a_cell_may_hold_several_checks():
    two = 'nb.check("04.1", x0_from)\nnb.check("04.2", further)'
    cell = checked(two, "✓ 04.1 right\n✗ 04.2 wrong\n")
    assert grading.marks({"cells": [cell]}) == {"04.1": nb.RIGHT, "04.2": nb.WRONG}


def test_a_copied_cell_that_was_not_run_leaves_the_mark():
    source = 'nb.check("04.1", x0_from)'
    cells = [checked(source, "✓ 04.1 right\n"), checked(source)]
    assert grading.marks({"cells": cells}) == {"04.1": nb.RIGHT}


def test_a_table_that_cannot_be_written_costs_no_marks(folder, tmp_path, capsys):
    assert nb.main(["grade", str(folder), "--csv", str(tmp_path)]) == 2  # a folder
    said = capsys.readouterr()
    assert "04.1  solved in 1 of 2" in said.out and str(tmp_path) in said.err


def test_marks_are_printed_where_there_is_no_tick(folder, monkeypatch):
    page = io.TextIOWrapper(io.BytesIO(), encoding="cp1252", write_through=True)
    monkeypatch.setattr("sys.stdout", page)
    assert nb.main(["grade", str(folder)]) == 0
    assert b"? 04.1" in page.buffer.getvalue()


def test_an_empty_folder_is_refused(tmp_path):
    with pytest.raises(ValueError, match="has no notebook"):
        grading.grade(tmp_path)


def test_a_stub_without_solution_is_named():
    check = nbformat.v4.new_code_cell('nb.check("77.7", nothing)')
    stub = nbformat.v4.new_code_cell("nothing = ...", metadata={"tags": ["exercise"]})
    with pytest.raises(ValueError, match=r"77\.7 has no stub"):
        grading.with_solutions(nbformat.v4.new_notebook(cells=[check]))
    with pytest.raises(ValueError, match=r"77\.7 has no solution"):
        grading.with_solutions(nbformat.v4.new_notebook(cells=[stub, check]))


def test_a_file_in_place_of_its_folder_is_named(tmp_path, capsys):
    (tmp_path / "01.ipynb").write_text('{"cells": []}')
    assert nb.main(["grade", str(tmp_path / "01.ipynb")]) == 2
    assert f"01.ipynb is a file; give its folder, {tmp_path}" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[]", "is JSON but no notebook"),
        ('{"a": 1}', "is JSON but no notebook"),
        ('{"cells": [3]}', "is JSON but no notebook"),
        ('{"cells": [{"cell_type": "code"}]}', "is JSON but no notebook"),
        ("{", "holds no JSON"),
    ],
)
def test_json_that_is_no_notebook_is_named(tmp_path, text, message):
    (tmp_path / "odd.ipynb").write_text(text)
    (row,) = grading.grade(tmp_path)
    assert row["failed"].startswith("ValueError: ") and f"odd.ipynb {message}" in row["failed"]
