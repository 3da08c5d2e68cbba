import ast
import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from dancediff import nb
from dancediff.motion.rotation import rot6d_to_matrix

BOOKS = Path(__file__).parents[2] / "notebooks"
LESSONS = sorted(BOOKS.glob("*.ipynb"))


def six_as_columns(d6):
    return rot6d_to_matrix(d6).mT


def six_not_squared(d6):
    a, b = (torch.nn.functional.normalize(v, dim=-1) for v in (d6[..., :3], d6[..., 3:]))
    return torch.stack([a, b, torch.linalg.cross(a, b)], dim=-2)


def six_left_handed(d6):
    R = rot6d_to_matrix(d6)
    return torch.cat([R[..., :2, :], -R[..., 2:, :]], dim=-2)


def six_changes_nothing(d6):
    return torch.eye(3).expand(*d6.shape[:-1], 3, 3)


def beat_frames(M):
    return np.flatnonzero(np.asarray(M)[:, 34] > 0.5)


NEAR_MISSES = {
    "00.1": [
        {"same seed again": False, "another seed": False, "another song": False},
        {"same seed again": True, "another seed": False, "another song": True},
        {"same seed again": True},
        True,
    ],
    "01.1": [six_as_columns, six_not_squared, six_left_handed, six_changes_nothing],
    "02.1": [
        lambda M: 60 * 30 / np.diff(beat_frames(M)).mean(),  # minds a missing beat
        lambda M: 60 / np.median(np.diff(beat_frames(M))),  # takes frames for seconds
        lambda M: 60 * 30 * len(beat_frames(M)) / len(M),
        lambda M: np.diff(beat_frames(M)),
    ],
    "03.1": [
        lambda train, test: sum(w in train for w in test),  # only the very same window
        lambda train, test: sum(take in {a for a, _ in train} for take, _ in test),  # any of a take
        lambda train, test: sum(a == b and abs(s - t) < 150 for a, s in test for b, t in train),
        lambda train, test: sum(
            any(a == b and abs(s - t) <= 150 for b, t in train) for a, s in test
        ),
        lambda train, test: sum(any(abs(s - t) < 150 for _, t in train) for _, s in test),
    ],
    "04.1": [
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]) * eps) / abar[t].sqrt(),  # no root
        lambda x_t, eps, t, abar: (x_t - (1 - abar[t]).sqrt() * eps) / abar[t],
        lambda x_t, eps, t, abar: (x_t + (1 - abar[t]).sqrt() * eps) / abar[t].sqrt(),
        lambda x_t, eps, t, abar: x_t - eps,
    ],
    "05.1": [
        lambda p_hat, p: (p_hat - p).square().mean(),  # places, not offsets
        lambda p_hat, p: (p_hat - p).diff(dim=0).square().mean(),  # neighbours only
        lambda p_hat, p: (p_hat - p).diff(dim=1).square().mean(),  # time, as the released code
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().mean(),  # with herself
        lambda p_hat, p: ((p_hat - p)[:, None] - (p_hat - p)).square().sum(),
    ],
    "06.1": [
        lambda net, x_t, w: net(x_t, music=True) + w * net(x_t, music=False),
        lambda net, x_t, w: w * net(x_t, music=True),
        lambda net, x_t, w: (1 + w) * net(x_t, music=True) - w * net(x_t, music=False),
        lambda net, x_t, w: (1 - w) * net(x_t, music=True) + w * net(x_t, music=False),
    ],
    "07.1": [
        lambda root: root[:, 0, 0].argsort(),  # who stands k-th, not which k
        lambda root: root[:, -1, 0].argsort().argsort(),  # at the last frame
        lambda root: root[:, 0, 2].argsort().argsort(),  # in depth
        lambda root: root[:, 0, 0].argsort(descending=True).argsort(),
        lambda root: root[:, 0, 0].argsort().argsort() + 1,
        lambda root: root[:, :, 0].argsort(0).argsort(0),  # of every frame
    ],
    "08.1": [
        lambda A, B, C, delta, length: (
            C * torch.exp(delta * A) ** torch.arange(1, length + 1)[:, None] * delta * B
        ).sum(-1),  # forgets in the pulse's own frame
        lambda A, B, C, delta, length: (
            C * torch.exp(delta * A) ** torch.arange(length)[:, None] * B
        ).sum(-1),  # no delta when it is written
        lambda A, B, C, delta, length: (C * A ** torch.arange(length)[:, None] * delta * B).sum(
            -1
        ),  # the rate instead of what a frame leaves
        lambda A, B, C, delta, length: (
            C * torch.exp(delta * A) ** torch.arange(length)[:, None] * delta * B
        ),  # one kernel for every state
        lambda A, B, C, delta, length: (
            (C * torch.exp(delta * A) ** torch.arange(length)[:, None] * delta * B).sum(-1).flip(0)
        ),
    ],
    "09.1": [
        lambda S1, S2: S2[S1],  # the wrong way round
        lambda S1, S2: S2,
        lambda S1, S2: S1.argsort()[S2],  # where a rank goes, not who stands in a place
        lambda S1, S2: S1[S2].argsort(),
        lambda S1, S2: (S1 + S2) % len(S1),
    ],
    "10.1": [
        lambda segments, overlap: torch.cat(list(segments), 1),  # the overlaps are danced twice
        lambda segments, overlap: torch.cat([s[:, overlap:] for s in segments], 1),  # starts late
        lambda segments, overlap: torch.cat(  # keeps the later version of the overlap
            [*(s[:, : s.shape[1] - overlap] for s in segments[:-1]), segments[-1]], 1
        ),
        lambda segments, overlap: torch.cat(  # takes the stride for the overlap
            [segments[0], *(s[:, s.shape[1] - overlap :] for s in segments[1:])], 1
        ),
    ],
    "11.1": [
        lambda v: ((v[:-2] < v[1:-1]) & (v[1:-1] >= v[2:])).nonzero()[:, 0] + 1,  # hills
        lambda v: ((v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:])).nonzero()[:, 0],  # a frame early
        lambda v: ((v[:-2] > v[1:-1]) & (v[1:-1] < v[2:])).nonzero()[:, 0] + 1,  # no flat valley
        lambda v: ((v[:-2] >= v[1:-1]) & (v[1:-1] <= v[2:])).nonzero()[:, 0] + 1,  # all of it
        lambda v: (v[1:-1] < v.mean()).nonzero()[:, 0] + 1,  # slow, not slowest
        lambda v: (v[:-2] > v[1:-1]) & (v[1:-1] <= v[2:]),  # which, not where
    ],
    "11.2": [
        lambda root: root - root[:, :1],  # heights, too
        lambda root: root - root.mean(1, keepdim=True) * torch.tensor([1.0, 0, 1]),
        lambda root: root - root[:1, :1] * torch.tensor([1.0, 0, 1]),  # all to the first one
        lambda root: root * torch.tensor([0.0, 1, 0]),  # and it goes nowhere
        lambda root: root - root[:, :1] * torch.tensor([1.0, 1, 0]),  # z is not up
    ],
    "12.1": [
        lambda R, swap: R[:, swap],  # partners, seen from the same side
        lambda R, swap: torch.diag(torch.tensor([-1.0, 1, 1])) @ R[:, swap],  # no rotation
        lambda R, swap: (
            torch.diag(torch.tensor([-1.0, 1, 1])) @ R @ torch.diag(torch.tensor([-1.0, 1, 1]))
        ),  # nobody changes sides
        lambda R, swap: R[:, swap] * torch.tensor([-1.0, 1, 1]),
        lambda R, swap: R[:, swap].mT,
    ],
    "12.2": [
        lambda times, s: sum(t > 50 * (1 - s) for t in times[:-2]),  # the released code
        lambda times, s: sum(t + 1 > (times[0] + 1) * s for t in times[:-2]),  # 1 - s
        lambda times, s: round(s * (len(times) - 1)),  # a share of the steps, not of the way
        lambda times, s: sum(t + 1 > (times[0] + 1) * (1 - s) for t in times[:-1]),  # the last, too
        lambda times, s: sum(t + 1 > 1000 * (1 - s) for t in times[1:-1]),  # where they end
    ],
    "12.3": [
        lambda real, made: -0.5 * (real - made).mean(),  # never content
        lambda real, made: 0.5 * ((1 + real).relu() + (1 - made).relu()).mean(),  # the other way
        lambda real, made: ((1 - real).relu() + (1 + made).relu()).mean(),  # twice as much
        lambda real, made: 0.5 * ((1 - real).relu() + (1 + made).relu()),  # one for each dance
        lambda real, made: 0.5 * ((-real).relu() + made.relu()).mean(),  # without the margin
    ],
    "13.1": [
        lambda dance: dance,
        lambda dance: dance.joints(),
        lambda dance: dance.frames(0, 1),
        lambda dance: replace(dance, root=2 * dance.root),
        lambda dance: replace(dance, root=dance.root.mean(1, keepdim=True).expand_as(dance.root)),
    ],
}


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


# ----------------------------------------------------------------------------- the checkers bite
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


@pytest.mark.parametrize("exercise", nb.EXERCISES)
@pytest.mark.parametrize("answer", [None, ..., lambda *_: None, lambda *_: ...])
def test_untouched_is_open(exercise, answer):
    if callable(answer) and not callable(nb.EXERCISES[exercise].spec):
        pytest.skip("no function is asked for")
    assert nb.judge(exercise, answer).mark == nb.OPEN


def test_not_implemented_is_open():
    def stub(d6):
        raise NotImplementedError

    assert nb.judge("01.1", stub).mark == nb.OPEN


@pytest.mark.parametrize("exercise", [*nb.EXERCISES, "77.7", ""])
@pytest.mark.parametrize(
    "answer", [lambda: 1, lambda *a: 1 / 0, "text", object(), lambda *a: object(), np.nan, []]
)
def test_check_never_raises(exercise, answer, capsys):
    nb.check(exercise, answer)
    nb.show(exercise, answer)
    assert capsys.readouterr().out.startswith((nb.WRONG, nb.OPEN))


def test_a_wrong_answer_sees_both_numbers(capsys):
    nb.check("01.1", six_changes_nothing)
    out = capsys.readouterr().out
    assert out.startswith(f"{nb.WRONG} 01.1 yours [1, 0, 0") and "expected [0." in out
    nb.check("01.1", lambda d6: d6)
    assert "shape (2, 6), expected (2, 3, 3)" in capsys.readouterr().out


def test_an_answer_cannot_spoil_the_check():
    def destructive(d6):
        d6.zero_()
        return rot6d_to_matrix(d6)

    assert nb.judge("01.1", destructive).mark == nb.WRONG
    assert nb.judge("01.1", rot6d_to_matrix).mark == nb.RIGHT


def test_nan_is_named():
    verdict = nb.judge("02.1", lambda M: float("nan"))
    assert "not finite" in verdict.text


def test_show_draws_two_rows_of_bars():
    figure = nb.show("04.1", lambda x_t, eps, t, abar: x_t)
    labels = [text.get_text() for text in figure.axes[0].get_legend().get_texts()]
    assert labels == ["yours", "expected"]


# -------------------------------------------------------------------------------- small helpers
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


# ---------------------------------------------------------------------------------- the lessons
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
