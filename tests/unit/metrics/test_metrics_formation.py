"""Formations: against what the choreographer planned, on groups made for it, on broken dances."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import choreograph
from dancediff.metrics.corruption import freeze, overlap_dancers
from dancediff.metrics.formation import (
    FORMATION,
    OTHER,
    crossings,
    depth,
    formations,
    hull_area,
    shape_distance,
)

BEATS = np.arange(0.4, 30, 0.5)


def group(places) -> torch.Tensor:
    """Joints of dancers who stand at places (n, 2), or (n, f, 2)."""
    places = torch.as_tensor(places, dtype=torch.float64)
    places = places[:, None].expand(-1, 300, -1) if places.ndim == 2 else places
    joints = torch.zeros(*places.shape[:2], 24, 3, dtype=torch.float64)
    joints[..., 0], joints[..., 2] = places[..., :1], places[..., 1:]
    return joints


@pytest.fixture(scope="module")
def dances():
    return [choreograph(BEATS, dancers=3 + seed % 3, seed=seed, seconds=30.0) for seed in range(12)]


def planned(truth) -> int:
    """Different formations of a plan, by the same measure; one that is left at once is none."""
    found: list[torch.Tensor] = []
    way = 8 * 15  # frames to the next formation
    stops = [frame - way for frame, *_ in truth.formations[1:]] + [900]
    for (start, _, slots), stop in zip(truth.formations, stops, strict=True):
        if stop - start < 30:
            continue
        shape = torch.tensor(slots - slots.mean(0))
        if all(shape_distance(shape, other) >= OTHER for other in found):
            found.append(shape)
    return len(found)


def test_formations_are_those_that_were_planned(dances):
    counts = np.array([(formations(d.joints()), planned(truth)) for d, truth in dances])
    assert np.abs(counts[:, 0] - counts[:, 1]).max() <= 1
    assert np.abs(counts[:, 0] - counts[:, 1]).mean() < 0.3
    assert counts[:, 0].max() >= 3


def test_a_formation_is_the_same_elsewhere_and_with_places_exchanged():
    line, wedge = [[-1.5, 0], [0, 0], [1.5, 0]], [[-1.5, -1.5], [0, 0], [1.5, -1.5]]
    parts = [line, wedge, [[3, 1], [4.5, 1], [1.5, 1]], wedge]
    whole = torch.cat([group(part)[:, :150] for part in parts], dim=1)
    assert formations(whole) == 2
    moving = torch.linspace(0, 6, 300, dtype=torch.float64)[:, None] * torch.tensor([1.0, 0.0])
    together = torch.tensor(line, dtype=torch.float64)[:, None] + moving
    assert formations(group(together)) == 1


def test_who_never_stands_has_no_formation():
    t = torch.arange(300) / 30
    away = torch.stack([1 + t, torch.zeros_like(t)], -1)
    assert formations(group(torch.stack([-away, away]))) == 0


def test_crossings_count_who_passes_and_not_who_sways(dances):
    t = torch.arange(900) / 30
    sway = torch.stack([0.1 * torch.sin(t), torch.zeros_like(t)], -1)
    assert crossings(group(torch.stack([sway, -sway]))) == 0
    passing = torch.stack([1.5 * torch.cos(2 * torch.pi * t / 20), torch.zeros_like(t)], -1)
    assert crossings(group(torch.stack([passing, -passing]))) == 3  # in 30 s, at 5, 15 and 25 s
    assert crossings(group(torch.stack([passing, -passing]))[:, :300]) == 3  # once in 10 s
    for dance, truth in dances:
        if list(truth.order_start) != list(truth.order_end):
            assert crossings(dance.joints()) > 0


def test_area_and_depth_of_known_groups():
    pentagon = [[0, 0], [2, 0], [2, 1], [0, 1], [1, 0.5]]
    assert hull_area(group(pentagon)) == pytest.approx(2)
    assert depth(group(pentagon)) == pytest.approx(1)
    in_line = [[0, 0], [1, 1], [3, 3]]
    assert hull_area(group(in_line)) == pytest.approx(0)
    with pytest.raises(ValueError, match="3"):
        hull_area(group(in_line[:2]))
    for metric, _ in FORMATION.values():
        with pytest.raises(ValueError, match="dancer"):
            metric(group([[0, 0]]))


def test_broken_dances_are_seen(dances):
    rng = np.random.default_rng(0)
    means = {}
    for name, damage in (
        ("good", lambda d: d),
        ("frozen", lambda d: freeze(d, 1.0, rng)),
        ("heap", lambda d: overlap_dancers(d, 1.0, rng)),
    ):
        joints = [damage(dance).joints() for dance, _ in dances]
        means[name] = {k: np.mean([m(j) for j in joints]) for k, (m, _) in FORMATION.items()}
    assert means["frozen"]["formations"] == 1 < means["good"]["formations"] - 0.8
    assert means["frozen"]["crossings"] == 0 < means["good"]["crossings"]
    assert means["heap"]["hull area"] < 1e-6 < means["good"]["hull area"]
    assert means["heap"]["depth"] < 1e-6 < means["good"]["depth"]


def test_the_best_order_of_many_is_searched_for(monkeypatch):
    first, second = torch.randn(2, 4, 7, 2, generator=torch.Generator().manual_seed(0))
    searched = shape_distance(first, second)
    monkeypatch.setattr("dancediff.metrics.formation.FEW", 7)
    torch.testing.assert_close(searched, shape_distance(first, second))
