"""The papers' tables beside a bench: numbers as printed, places, and which pairs agree."""

import math

import pytest

from dancediff.bench.paper_tables import (
    agreement,
    beside,
    markdown,
    means,
    paper_tables,
    papers_beside,
)
from dancediff.extensions.build import NETWORKS

TABLES = paper_tables()


def found(**fid):
    """Systems with this FID_k, and 1.0 for every other metric."""
    metrics = {ours for table in TABLES.values() for _, ours, _ in table.metrics}
    return {
        system: {m: [value if m == "FID_k" else 1.0] * 3 for m in metrics}
        for system, value in fid.items()
    }


@pytest.mark.parametrize("table", TABLES.values(), ids=TABLES)
def test_a_table_is_whole(table):
    assert set(table.systems) <= set(NETWORKS)  # each can be trained here
    assert {better for *_, better in table.metrics} == {"up", "down"}
    assert {len(values) for values in table.systems.values()} == {len(table.metrics)}


def test_the_paper_s_own_system_is_first_where_the_paper_says_so():
    group = {row[1]: row for row in beside(TABLES["tcdiffpp"], found(EDGE=2.0, TCDiffPP=1.0))[:2]}
    assert (group["TCDiffPP"][2:4], group["EDGE"][2:4]) == ([10.66, 1], [63.35, 2])


def test_places_here_follow_the_values_here():
    rows = beside(TABLES["tcdiffpp"], found(EDGE=1.0, GCD=3.0, TCDiffPP=2.0))
    fid = next(k for k, row in enumerate(rows) if row[0].startswith("FID ↓"))
    assert [(row[1], row[5]) for row in rows[fid : fid + 3]] == [
        ("EDGE", 1), ("GCD", 3), ("TCDiffPP", 2)
    ]  # fmt: skip
    # the paper: TCDiffPP 21.7, GCD 31.2, EDGE 31.4; here EDGE is before both
    assert rows[fid][0] == "FID ↓: 1 of 3 pairs in the same order"


def test_ties_of_the_paper_are_no_pairs_and_ties_here_are_not_the_same_order():
    assert agreement([0.10, 0.10, 0.36], [1.0, 2.0, 3.0]) == (2, 2)
    assert agreement([1.0, 2.0], [5.0, 5.0]) == (0, 1)


def test_seeds_are_averaged_and_other_budgets_left_out():
    points = [
        {"config": "a", "minutes": minutes, "seed": seed, "scores": {"150": {"GMR": [value, 0, 9]}}}
        for minutes, seed, value in ((10, 0, 4.0), (10, 1, 6.0), (5, 0, 100.0))
    ]
    points.append({"config": "held-out dances", "scores": {"150": {"GMR": [0.0, 0, 0]}}})
    assert means(points, {"a": "EDGE"}, 10, 150) == {"EDGE": {"GMR": [5.0, 4.0, 6.0]}}
    points[0]["scores"]["150"]["GMR"][0] = None
    assert math.isnan(means(points, {"a": "EDGE"}, 10, 150)["EDGE"]["GMR"][0])


def test_a_system_without_a_value_has_no_place():
    rows = beside(TABLES["tcdiffpp"], found(EDGE=1.0, GCD=math.nan, TCDiffPP=2.0))
    fid = next(k for k, row in enumerate(rows) if row[0].startswith("FID ↓"))
    assert [row[5] for row in rows[fid : fid + 3]] == [1, None, 2]
    assert "| GCD | 31.16 | 2 | nan | - |" in markdown(rows)


def test_one_system_alone_has_no_order():
    assert beside(TABLES["lodge"], found(Lodge=1.0)) == []
    assert papers_beside([], {"a": "EDGE"}, 10, 150) == {}


def test_shares_are_in_percent_where_the_papers_are():
    rows = beside(TABLES["lodge"], found(EDGE=1.0, Lodge=2.0))
    fsr = next(row for row in rows if row[0].startswith("FSR (%)"))
    assert fsr[4] == [100.0] * 3
