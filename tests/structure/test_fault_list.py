"""The faults of `make mutants` can be put into today's source, and reach every equation."""

import ast
import sys
from collections import Counter

import pytest

from places import BENCHMARKS, SOURCE

sys.path.insert(0, str(BENCHMARKS))
from mutants import ROOT, faults_of

FAULTS = faults_of()
EQUATIONS = {f"TCDiff++ {k}" for k in range(1, 20)} | {f"Lodge {k}" for k in range(1, 11)}
PARTS = {"data", "diffusion", "exercises", "extensions", "metrics", "nn", "papers", "training"}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_fits_its_file(fault):
    text = (SOURCE / fault.file).read_text(encoding="utf-8")
    sound, faulty = (ast.dump(ast.parse(one)) for one in (text, fault.applied(text)))
    assert sound != faulty
    for test in fault.covering():
        assert (ROOT / test.split("::")[0]).is_file()
        for name in test.split("::")[1:]:
            assert f"def {name}(" in (ROOT / test.split("::")[0]).read_text(encoding="utf-8")


def test_names_are_unique():
    assert Counter(fault.name for fault in FAULTS).most_common(1)[0][1] == 1


def test_every_numbered_equation_and_every_part_has_one():
    assert {fault.equation for fault in FAULTS} - {""} == EQUATIONS
    assert PARTS <= {fault.file.split("/")[0] for fault in FAULTS}
    assert len(FAULTS) >= 120
