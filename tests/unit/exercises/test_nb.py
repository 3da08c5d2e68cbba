import ast
import json
import re
import subprocess
import sys
from itertools import pairwise

import matplotlib
import numpy as np
import pytest
import torch
from near_misses import NEAR_MISSES
from near_misses.lesson_01 import six_changes_nothing
from near_misses.lesson_10 import along_dancers, slices_a_list

from dancediff import nb
from dancediff.motion.rotation import rot6d_to_matrix
from dancediff.viz.palette import DANCER_COLORS
from places import BOOKS

LESSONS = sorted(BOOKS.glob("*.ipynb"))
RAISING = along_dancers, slices_a_list  # near misses that raise; all others give an answer


def run_solution(exercise):
    """The last name a solution defines."""
    space: dict = {}
    text = nb.solution_text(exercise)
    exec(text, space)
    names = [
        node.name if isinstance(node, ast.FunctionDef) else node.targets[0].id
        for node in ast.parse(text).body
        if isinstance(node, ast.FunctionDef | ast.Assign)
    ]
    return names[-1], space[names[-1]]


def cells(path, tag):
    book = json.loads(path.read_text(encoding="utf-8"))
    return [c for c in book["cells"] if tag in c["metadata"].get("tags", [])]


def source(cell):
    return "".join(cell["source"])


@pytest.mark.parametrize("exercise", nb.EXERCISES)
def test_solution_is_right(exercise):
    assert nb.judge(exercise, run_solution(exercise)[1]).mark == nb.RIGHT


@pytest.mark.parametrize("exercise", nb.EXERCISES)
def test_near_misses_are_wrong_and_get_a_hint(exercise):
    assert len(NEAR_MISSES[exercise]) >= 2
    for answer in NEAR_MISSES[exercise]:
        verdict = nb.judge(exercise, answer)
        assert verdict.mark == nb.WRONG, verdict
        assert "hint:" in verdict.text or "expected" in verdict.text
        raised = "your code raised" in verdict.text  # what else it does would not be judged
        assert raised == any(answer is one for one in RAISING), verdict


@pytest.mark.parametrize("exercise", nb.EXERCISES)
@pytest.mark.parametrize("answer", [None, ..., lambda *_: None, lambda *_: ...])
def test_untouched_is_open(exercise, answer):
    if callable(answer) and not callable(nb.EXERCISES[exercise].spec):
        pytest.skip("no function is asked for")
    assert nb.judge(exercise, answer).mark == nb.OPEN


def test_not_implemented_is_open():
    def stub(d6):
        raise NotImplementedError

    assert nb.judge("01.3", stub).mark == nb.OPEN


@pytest.mark.parametrize("exercise", [*nb.EXERCISES, "77.7", ""])
@pytest.mark.parametrize(
    "answer", [lambda: 1, lambda *a: 1 / 0, "text", object(), lambda *a: object(), np.nan, []]
)
def test_check_never_raises(exercise, answer, capsys):
    nb.check(exercise, answer)
    nb.show(exercise, answer)
    assert capsys.readouterr().out.startswith((nb.WRONG, nb.OPEN))


def test_a_wrong_answer_sees_both_numbers(capsys):
    nb.check("01.3", six_changes_nothing)
    out = capsys.readouterr().out
    assert out.startswith(f"{nb.WRONG} 01.3 yours [1, 0, 0") and "expected [0." in out
    assert 'nb.show("01.3", six_changes_nothing)' in out
    nb.check("01.3", lambda d6: d6)
    assert "shape (2, 6), expected (2, 3, 3)" in capsys.readouterr().out


def test_an_answer_cannot_spoil_the_check():
    def destructive(d6):
        d6.zero_()
        return rot6d_to_matrix(d6)

    assert nb.judge("01.3", destructive).mark == nb.WRONG
    assert nb.judge("01.3", rot6d_to_matrix).mark == nb.RIGHT


def spoils_tensor(root):
    """Exercise 11.4 solved, in place."""
    root[..., (0, 2)] -= root[:, :1, (0, 2)].clone()
    return root


def spoils_motion(dance):
    """Exercise 13.5 solved, in place."""
    dance.root += torch.tensor([20.0, 0.0, 20.0])
    return dance


def spoils_list(times, s):
    """Exercise 12.2 solved, on what is left of the list."""
    held = run_solution("12.2")[1](times, s)
    times.pop()
    return held


def spoils_array(music, motion):
    """Exercise 13.3 solved, in seconds since the first beat."""
    first = music[0]
    music -= first
    motion -= first
    return run_solution("13.3")[1](music, motion)


@pytest.mark.parametrize(
    ("exercise", "answer", "what"),
    [
        ("11.4", spoils_tensor, "a tensor (13, 8, 3)"),
        ("12.2", spoils_list, "a list"),
        ("13.3", spoils_array, "an array (20,)"),
        ("13.5", spoils_motion, "a Motion"),
    ],
)
def test_an_answer_leaves_its_arguments_as_they_were(exercise, answer, what):
    verdict = nb.judge(exercise, answer)
    assert verdict.mark == nb.WRONG
    assert f"changes what it is given, {what}" in verdict.text and "copy" in verdict.text
    assert nb.judge(exercise, run_solution(exercise)[1]).mark == nb.RIGHT


def test_a_wrong_answer_is_told_where():
    def one_off(segments, overlap):
        dance = run_solution("10.1")[1](segments, overlap)
        dance[1, 12, 2] += 1
        return dance

    text = nb.judge("10.1", one_off).text
    assert ", first difference at [1, 12, 2] for" in text and text.startswith("yours […, ")
    yours, right = ([float(v) for v in re.findall(r"-?\d+\.\d+", half)] for half in _halves(text))
    assert [round(a - b, 2) for a, b in zip(yours, right, strict=True)] == [0, 0, 1, 0, 0, 0]


def _halves(text):
    return re.match(r"yours \[(.*)\], expected \[(.*)\], first", text).groups()


def test_nan_is_named():
    verdict = nb.judge("02.2", lambda M: float("nan"))
    assert "not finite" in verdict.text


def test_show_draws_two_rows_of_bars():
    figure = nb.show("04.1", lambda x_t, eps, t, abar: x_t)
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels == ["yours", "expected"]


@pytest.mark.parametrize("exercise", nb.EXERCISES)
def test_show_draws_numbers_or_says_why_not(exercise, capsys):
    task = nb.EXERCISES[exercise]
    figure = nb.show(exercise, run_solution(exercise)[1])
    out = capsys.readouterr().out
    if not callable(task.spec):
        assert figure is None and "nothing to draw" in out
    elif task.accepts:
        assert figure is None and out.startswith(f"{nb.RIGHT} {exercise} {task.title}")
        assert "judged by what it achieves" in out
    else:
        assert figure is not None and out == ""


def test_show_says_how_many_numbers_have_no_bar():
    ax = nb.show("04.1", lambda x_t, eps, t, abar: x_t / 0).axes[0]
    yours, expected = (text.get_text() for text in ax.get_legend().get_texts())
    assert yours.startswith("yours (24 ") and expected == "expected" and ax.get_xlabel()


def test_lessons_draw_in_the_colours_of_dancers():
    nb.setup(4)
    assert matplotlib.rcParams["axes.prop_cycle"].by_key()["color"] == list(DANCER_COLORS)


def test_show_says_what_is_wrong_where_nothing_is_drawn(capsys):
    assert nb.show("13.5", lambda dance: dance) is None
    out = capsys.readouterr().out
    assert out.startswith(f"{nb.WRONG} 13.5 the published features grow 1.0 times")
    assert "judged by what it achieves" in out


@pytest.mark.parametrize("exercise", ["04.1", "04.4", "04.3", "77.7"])
def test_show_waits_for_an_answer(exercise, capsys):
    assert nb.show(exercise, lambda *_: ...) is None
    assert "nothing to draw" in capsys.readouterr().out


def test_setup_seeds_and_report_lists_the_lesson(capsys):
    nb.setup(4)
    first = torch.rand(3)
    nb.setup(4)
    assert torch.equal(torch.rand(3), first)
    nb.check("04.1", run_solution("04.1")[1])
    nb.report()
    out = capsys.readouterr().out
    assert f"{nb.RIGHT} 04.1 undo the noise\n" in out and "01.1" not in out
    nb.setup(4)
    nb.report()
    assert f"{nb.OPEN} 04.1" in capsys.readouterr().out


def test_a_report_without_a_lesson_says_so(capsys, monkeypatch):
    monkeypatch.setitem(nb._lesson, "number", None)
    nb.report()
    assert capsys.readouterr().out.startswith("no lesson is set up; run the cell with nb.setup")


def test_resume_sets_up_once(capsys):
    nb.setup(98)
    nb.resume(4)  # another lesson: begun here
    nb.check("04.1", lambda *_: 0)
    nb._lesson["start"] -= 100
    nb.resume(4)  # the same: marks and clock stay
    capsys.readouterr()
    nb.report()
    said = capsys.readouterr().out
    assert nb.WRONG in said.splitlines()[0]
    assert int(re.search(r"(\d+) s since", said)[1]) >= 100


def test_setup_refuses_a_negative_lesson():
    with pytest.raises(ValueError, match="lesson=-1"):
        nb.setup(-1)


def test_same_is_a_test():
    with pytest.raises(AssertionError):
        nb.same(torch.zeros(2), torch.ones(2), "ones")


def test_solution_explains(capsys):
    nb.solution("04.1")
    out = capsys.readouterr().out
    assert out.startswith("# ") and "def x0_from" in out
    nb.solution("77.7")
    assert "no solution" in capsys.readouterr().out


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_every_exercise_has_stub_checker_and_solution(path):
    stubs, checks = cells(path, "exercise"), cells(path, "check")
    keys = [re.search(r'nb\.check\("([\d.]+)", (\w+)\)', source(c)).groups() for c in checks]
    assert len(stubs) == len(checks) >= 1
    for stub, (key, name) in zip(stubs, keys, strict=True):
        space: dict = {}
        exec(source(stub), space)
        assert nb.judge(key, space[name]).mark == nb.OPEN
        assert run_solution(key)[0] == name
        assert key.startswith(path.stem[:2])


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_exercises_are_numbered_in_reading_order(path):
    book = json.loads(path.read_text(encoding="utf-8"))
    text = "\n".join(source(c) for c in book["cells"])
    lesson = path.stem[:2]
    shown = [key for key in nb.EXERCISES if key.startswith(lesson)]
    assert shown == [f"{lesson}.{k + 1}" for k in range(len(shown))]
    assert re.findall(r"### 🧩 Exercise ([\d.]+)", text) == shown
    assert re.findall(r'nb\.check\("([\d.]+)"', text) == shown
    solutions = (BOOKS / "solutions" / f"{lesson}.py").read_text(encoding="utf-8")
    assert re.findall(r"^# %% ([\d.]+)$", solutions, re.MULTILINE) == shown


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_lesson_is_clean(path):
    text = path.read_text(encoding="utf-8")
    book = json.loads(text)
    code = [c for c in book["cells"] if c["cell_type"] == "code"]
    assert [c["execution_count"] for c in code] == list(range(1, len(code) + 1))
    assert len(text) <= 400_000
    assert max(len(source(c).splitlines()) for c in code) <= 25
    assert max(len(source(c).split()) for c in book["cells"] if c not in code) <= 150
    assert "widgets" not in book["metadata"]
    assert not re.search(r'"(/home|/root|/work|/tmp|[A-Z]:\\\\)', text)
    assert not re.search(r"^\s*[!%]", "\n".join(map(source, code)), re.MULTILINE)
    outputs = [o for c in code for o in c["outputs"]]
    assert not [o for o in outputs if o["output_type"] == "error"]
    assert any("image/png" in o.get("data", {}) for o in outputs)
    assert not [o for o in outputs if o.get("name") == "stderr"]
    assert '"application/vnd.jupyter.widget-view+json"' not in text  # dead without a kernel


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_code_comes_in_portions(path):
    """At most 35 lines of code, in one cell or in several, before a text follows."""
    portion = 0
    for cell in json.loads(path.read_text(encoding="utf-8"))["cells"]:
        code = cell["cell_type"] == "code"
        portion = portion + len(source(cell).splitlines()) if code else 0
        assert portion <= 35, source(cell)


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_lesson_has_its_parts(path):
    book = json.loads(path.read_text(encoding="utf-8"))
    prose = "\n".join(source(c) for c in book["cells"] if c["cell_type"] == "markdown")
    for part in ("**By the end you can**", "destination first", "$$", "## Recap", "🧩 Exercise"):
        assert part in prose, part
    assert "What the official code does differently" in prose
    assert source(book["cells"][2]).rstrip().endswith(f"nb.setup({int(path.stem[:2])})")
    assert source(book["cells"][-1]).strip() == "nb.report()"
    assert cells(path, "widget") and cells(path, "nbval-check-output")
    for link in re.findall(r"\]\(([\w.]+\.ipynb)\)", prose):
        assert (BOOKS / link).exists(), link


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_a_picture_comes_soon_and_in_every_section(path):
    book = json.loads(path.read_text(encoding="utf-8"))
    section, pictures, code, first = None, {}, 0, None
    for cell in book["cells"]:
        if cell["cell_type"] == "markdown":
            for section in re.findall(r"^## (.+)$", source(cell), re.MULTILINE):
                pictures[section] = 0
            continue
        code += 1
        shown = {kind for output in cell["outputs"] for kind in output.get("data", {})}
        if "image/png" in shown or "widget" in cell["metadata"].get("tags", []):
            first = first or code
            pictures[section] += 1
    assert first <= 3
    assert [name for name, count in pictures.items() if not count] == ["Recap"]


EQUATIONS = {"TCDiff++": range(1, 20), "Lodge": range(1, 11)}
NUMBERS = r"\d+(?:(?: to | and |, |-)\d+)*"


def numbers(text: str) -> set[int]:
    """Of "9 and 10", "5-7" or "2, 4 to 6"."""
    found = set()
    for first, last in re.findall(r"(\d+)(?:(?: to |-)(\d+))?", text):
        found |= set(range(int(first), int(last or first) + 1))
    return found


def equations(path) -> dict[str, set[int]]:
    """What a lesson says it teaches, on its first lines, if its text has these equations."""
    book = json.loads(path.read_text(encoding="utf-8"))
    first, *prose = [source(c) for c in book["cells"] if c["cell_type"] == "markdown"]
    papers = r"TCDiff\+\+|Lodge|DDPM|DDIM|DPM-Solver|Nichol|Karras|Salimans|Zhou|EDGE|Mamba"
    claimed, paper = {name: set() for name in EQUATIONS}, None
    for name, found in re.findall(rf"({papers})|eq\. ({NUMBERS})", first):
        if name:
            paper = name
        elif paper in claimed:
            claimed[paper] |= numbers(found)
    text = "\n".join(prose)
    told = re.findall(rf"eq\. ({NUMBERS})|\\q?quad \((\d+)\)", text, re.IGNORECASE)
    there = set().union(*(numbers(a or b) for a, b in told), set())
    missing = {name: wanted - there for name, wanted in claimed.items() if wanted - there}
    assert not missing, f"{path.stem} promises more than it has: {missing}"
    return claimed


def test_every_equation_of_both_papers_is_in_a_lesson():
    lessons = [equations(path) for path in LESSONS]
    for paper, wanted in EQUATIONS.items():
        assert set(wanted) == set().union(*(lesson[paper] for lesson in lessons)), paper


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_one_may_begin_in_the_middle(path):
    """Whatever a "start here" cell and those behind it use, they make themselves."""
    book = json.loads(path.read_text(encoding="utf-8"))
    starts = [i for i, c in enumerate(book["cells"]) if "jump-in" in c["metadata"].get("tags", [])]
    assert len(starts) in (2, 3)
    for start in starts:
        rest = [source(c) for c in book["cells"][start:] if c["cell_type"] == "code"]
        assert rest[0].startswith("# ▶ Start here")
        assert f"nb.resume({int(path.stem[:2])})" in rest[0]
        assert _undefined("\n".join(rest)) == ""


def _undefined(code: str) -> str:
    """What a linter says about names that nobody defines."""
    ruff = [sys.executable, "-m", "ruff", "check", "--isolated", "--select=F821", "--quiet"]
    known = ["--config", 'builtins=["display"]', "--output-format=concise", "-"]
    run = subprocess.run([*ruff, *known], input=code, capture_output=True, text=True, check=False)
    return run.stdout


def test_a_name_that_nobody_defines_is_found():
    assert _undefined("x = 1\nprint(x)") == ""
    assert "undefined_name" in _undefined("print(undefined_name)").replace("`", "")


@pytest.mark.parametrize("path", LESSONS, ids=lambda p: p.stem)
def test_every_panel_has_a_picture_for_readers_without_a_kernel(path):
    book = json.loads(path.read_text(encoding="utf-8"))["cells"]
    for before, cell in pairwise(book):
        if cell["cell_type"] == "code" and "panels.explore(" in source(cell):
            kinds = {kind for out in before.get("outputs", []) for kind in out.get("data", {})}
            assert "image/png" in kinds, source(cell)
