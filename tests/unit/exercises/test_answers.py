"""Every checker against wrong answers of many kinds, and against right ones written otherwise.

To add one: `near_misses/lesson_NN.py` (wrong) or `other_ways.py` (right).
"""

import numpy as np
import pytest
import torch
from near_misses import NEAR_MISSES
from other_ways import OTHER_WAYS

from dancediff import nb

PREDICTIONS = [key for key, task in nb.EXERCISES.items() if isinstance(task.spec, dict)]
FUNCTIONS = [key for key in nb.EXERCISES if key not in PREDICTIONS]
EXACT = [key for key in FUNCTIONS if nb.EXERCISES[key].accepts is None]


def numbers(value):
    return torch.as_tensor(value).double()


ALTERED = {  # what may be done to every right answer that is compared number by number
    "zeros": torch.zeros_like,
    "ones": torch.ones_like,
    "the sign turned": torch.neg,
    "twice as much": lambda right: 2 * right,
    "one more": lambda right: right + 1,
    "one per cent more": lambda right: 1.01 * right + 0.001,
    "one axis more": lambda right: right[None],
}
REARRANGED = {  # and to answers of several numbers
    "backwards": lambda right: right.flip(0),
    "all but the last": lambda right: right[:-1],
    "the mean of all": lambda right: right.mean().expand_as(right) + 0.001,
    "one place on": lambda right: right.roll(1, 0),
    "the last number off": lambda right: torch.cat(
        [right.flatten()[:-1], right.flatten()[-1:] + 1]
    ).reshape(right.shape),
}


def wrong_parts(spec):
    """Every prediction with one part wrong, and that with all parts wrong."""
    other = {
        key: not value if isinstance(value, bool) else value + 1 for key, value in spec.items()
    }
    return [spec | {key: value} for key, value in other.items()] + [other]


@pytest.mark.parametrize("exercise", FUNCTIONS)
def test_what_is_right_may_be_written_otherwise(exercise):
    assert len(OTHER_WAYS[exercise]) >= 2
    for answer in OTHER_WAYS[exercise]:
        verdict = nb.judge(exercise, answer)
        assert verdict.mark == nb.RIGHT, (answer, str(verdict))


@pytest.mark.parametrize("exercise", PREDICTIONS)
def test_a_prediction_may_be_of_other_types(exercise):
    right = nb.EXERCISES[exercise].spec
    kinds = {True: np.bool_, False: np.float64}
    as_numpy = {key: kinds[isinstance(v, bool)](v) for key, v in right.items()}
    for same in (dict(reversed(right.items())), as_numpy):
        assert nb.judge(exercise, same).mark == nb.RIGHT


@pytest.mark.parametrize("exercise", PREDICTIONS)
def test_one_wrong_part_is_wrong(exercise):
    right = nb.EXERCISES[exercise].spec
    for answer in wrong_parts(right):
        count = sum(answer[key] == right[key] for key in right)
        verdict = nb.judge(exercise, answer)
        assert verdict.mark == nb.WRONG
        assert verdict.text.startswith(f"{count} of {len(right)} are right\n   hint: ")
        off = next(key for key in right if answer[key] != right[key])
        assert verdict.more == f"look again at {off!r}"


@pytest.mark.parametrize("how", ALTERED | REARRANGED)
@pytest.mark.parametrize("exercise", EXACT)
def test_an_altered_right_answer_is_wrong(exercise, how):
    task = nb.EXERCISES[exercise]
    if how in REARRANGED and numbers(task.spec(*task.cases()[0])).ndim == 0:
        pytest.skip("one number cannot be rearranged")
    change = (ALTERED | REARRANGED)[how]
    verdict = nb.judge(exercise, lambda *case: change(numbers(task.spec(*case))))
    assert verdict.mark == nb.WRONG, verdict
    assert "expected" in verdict.text and "hint:" in verdict.text


@pytest.mark.parametrize("exercise", [key for key in FUNCTIONS if nb.EXERCISES[key].cases()[0]])
def test_an_answer_to_the_first_case_only_is_wrong(exercise):
    task = nb.EXERCISES[exercise]
    first = task.spec(*task.cases()[0])
    assert nb.judge(exercise, lambda *case: first).mark == nb.WRONG


def test_there_are_enough_of_them():
    by_hand = sum(map(len, NEAR_MISSES.values()))
    assert by_hand >= 250
    for exercise in nb.EXERCISES:
        parts = wrong_parts(nb.EXERCISES[exercise].spec) if exercise in PREDICTIONS else []
        assert len(NEAR_MISSES[exercise]) + len(parts) >= 5, exercise


def test_a_first_wrong_prediction_is_told_how_many_parts_are_right(capsys):
    nb.setup(5)
    answer = dict(nb.EXERCISES["05.1"].spec) | {"vel": True}
    nb.check("05.1", answer)
    said = capsys.readouterr().out
    assert said.startswith(f"{nb.WRONG} 05.1 4 of 5 are right") and "vel" not in said
    nb.check("05.1", answer)
    assert capsys.readouterr().out.endswith("look again at 'vel'\n")


def test_a_part_of_another_kind_is_named():
    right = nb.EXERCISES["01.1"].spec
    text = nb.judge("01.1", right | {"9 chest": "12"}).text
    assert text.startswith("'9 chest': '12' is a text, expected a number without quotation marks")
    assert "is a list, expected a number" in nb.judge("01.1", right | {"0 root": [23]}).text
    assert "expected a number" in nb.judge("01.1", right | {"0 root": True}).text


def test_a_prediction_half_made_is_open():
    verdict = nb.judge("01.1", nb.EXERCISES["01.1"].spec | {"9 chest": ...})
    assert verdict.mark == nb.OPEN
    assert verdict.text == "1 of 4 have no answer yet, first '9 chest'"


@pytest.mark.parametrize(
    ("exercise", "answer", "says"),
    [
        ("01.2", lambda pose: pose.tolist(), "a list, cannot be read"),
        ("04.4", lambda eps, abar: 960, "an int, cannot be read"),
        ("11.1", lambda v: [[1, 2], [3]], "not all numbers, or ragged"),
        ("07.1", lambda h: h + h.mean(), "groups do not hear each other"),
    ],
)
def test_an_answer_of_another_form_is_told_so(exercise, answer, says):
    verdict = nb.judge(exercise, answer)
    assert verdict.mark == nb.WRONG and says in verdict.text
