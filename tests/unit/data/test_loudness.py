"""The choreographer follows the loudness of music: more movement, accents, held breaks."""

import numpy as np
import pytest
import torch

from dancediff.data.choreographer import GENRES, choreograph
from dancediff.data.choreographer.assemble import assemble, plan_parts
from dancediff.data.choreographer.breath import ACCENTS, HOLD
from dancediff.data.choreographer.formations import min_distance
from dancediff.data.choreographer.grid import make_grid
from dancediff.data.choreographer.loudness import amount, cut_at_drops, heard
from dancediff.data.choreographer.score import Count, Score
from dancediff.data.choreographer.structure import Section
from dancediff.data.choreographer.ways import quick_look, way_on_counts, ways_of
from dancediff.motion.contact import feet_low, foot_speed

SECONDS = 32
BEATS = np.arange(0.3, SECONDS + 1, 0.55)
VERSE, CHORUS = 0.38, 0.72
LEVELS = np.repeat([VERSE, CHORUS, VERSE, CHORUS], SECONDS * 30 // 4)
SMOOTH = np.convolve(np.pad(LEVELS, 15, mode="edge"), np.full(31, 1 / 31), "valid")


def windows(curve, size):
    return np.asarray(curve)[: len(curve) // size * size].reshape(-1, size).mean(1)


def test_louder_music_is_danced_with_more_movement():
    """In every genre, and in the mean over them as closely as the benchmark asks for."""
    found = {}
    for genre in GENRES:
        each = []
        for seed in range(4):
            dance, _ = choreograph(
                BEATS, dancers=1 + seed, seed=seed, seconds=SECONDS, genre=genre, energy=SMOOTH
            )
            joints = dance.joints()
            speed = 30 * joints.diff(dim=1).norm(dim=-1).mean((0, 2)).numpy()
            assert 0.13 < windows(speed, 150).min() and windows(speed, 150).max() < 0.9
            assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.12
            assert min_distance(dance.root[..., (0, 2)].numpy()) > 0.45
            assert (foot_speed(joints) < 0.015)[feet_low(joints)].float().mean() > 0.93
            each.append(np.corrcoef(windows(speed, 60), windows(SMOOTH, 60)[:15])[0, 1])
        found[genre] = np.mean(each)
    assert min(found.values()) > 0.45, found
    assert np.mean(list(found.values())) > 0.7, found


def score_of(monkeypatch, **options):
    """A dance, and the score behind it."""
    import importlib

    module = importlib.import_module("dancediff.data.choreographer.choreograph")
    kept, write = [], module.write_score
    monkeypatch.setattr(module, "write_score", lambda *a: kept.append(write(*a)) or kept[-1])
    dance, _ = choreograph(**options)
    return dance, kept[-1]


def test_a_drop_is_accented_by_all_and_a_break_is_held(monkeypatch):
    energy = np.full(SECONDS * 30, 0.7)
    energy[360:480] = 0.2  # a break, then a drop
    for seed, genre in enumerate(GENRES):
        _, score = score_of(
            monkeypatch, beats=BEATS, dancers=3, seed=seed, seconds=SECONDS, genre=genre,
            energy=energy,
        )  # fmt: skip
        grid = make_grid(BEATS, SECONDS * 30)
        for row in score.counts:
            accents = [k for k, count in enumerate(row) if count.move in ACCENTS]
            held = [k for k, count in enumerate(row) if count.move is HOLD]
            assert abs(grid.frame(accents[0]) - 480) < 25 and len(accents) == 4
            assert abs(grid.frame(held[0]) - 360) < 25 and len(held) <= 4
        assert [c.move for c in score.counts[0]].index(HOLD) == held[0]


def test_a_section_begins_on_a_drop():
    sections = [Section(0, 15, "verse", 0), Section(15, 40, "chorus", 0)]
    assert [s.start for s in cut_at_drops(sections, [17])] == [0, 17]
    assert [s.label for s in cut_at_drops(sections, [30])] == ["verse", "chorus", "chorus"]
    assert cut_at_drops(sections, [38]) == sections  # too near to the end


def test_even_music_is_danced_about_as_without_loudness():
    """The amount of movement at the energy of even music is near the usual one."""
    assert amount(np.array([0.65]))[0] == pytest.approx(1.2, abs=0.01)
    speed = {}
    for name, energy in {"without": None, "even": np.full(SECONDS * 30, 0.65)}.items():
        made = [
            choreograph(BEATS, dancers=2, seed=s, seconds=SECONDS, genre=g, energy=energy)[0]
            for s, g in enumerate(GENRES)
        ]
        speed[name] = np.mean([d.joints().diff(dim=1).norm(dim=-1).mean() for d in made])
    assert 0.75 < speed["even"] / speed["without"] < 1.25


def test_ways_of_moves_are_those_danced():
    """Strong moves go further than calm ones, and a look at a third of the frames tells as much."""
    ways = {name: ways_of(genre) for name, genre in GENRES.items()}
    strong, calm = (
        np.mean([ways[g.name][m.name] for g in GENRES.values() for m in g.moves if m.energy == e])
        for e in (3, 1)
    )
    assert strong > 1.2 * calm
    genre, grid = GENRES["jazz"], make_grid(BEATS, SECONDS * 30)
    counts = [Count(genre.moves[k // 8 % 4], k % 8, False) for k in range(grid.length)]
    score = Score([counts], np.zeros((1, len(counts), 2)))
    body = assemble(plan_parts(score, genre, grid, 1.0, [0]), genre, grid)
    whole = way_on_counts(body, grid, len(counts))[0, 4:-4]
    quick = quick_look(score, genre, grid)[0, 4:-4]
    assert np.corrcoef(whole, quick)[0, 1] > 0.85


def test_the_same_seed_and_curve_make_the_same_dance():
    a, b = (choreograph(BEATS, dancers=2, seed=1, seconds=9, energy=SMOOTH[:270])[0] for _ in "ab")
    assert torch.equal(a.pose, b.pose)


def test_a_gap_has_no_drop():
    """Loudness that returns with the beat is danced from the first beat on."""
    beats = BEATS[BEATS > 8]
    energy = np.where(np.arange(SECONDS * 30) < 240, 0.1, 0.7)
    grid = make_grid(beats, SECONDS * 30)
    genre = GENRES["house"]
    loud, grid = heard(energy, grid, genre, ways_of(genre))
    ((_, stop),) = grid.gaps
    assert loud.drops == (stop,)
    assert grid.swing[:200].max() < 0.2 and grid.swing[300:].min() > 1


@pytest.mark.parametrize("bad", [np.full(960, 2.0), np.full(960, np.nan), np.zeros((2, 960))])
def test_a_wrong_curve_is_named(bad):
    with pytest.raises(ValueError, match=r"energy must be a curve"):
        choreograph(BEATS, seconds=SECONDS, energy=bad)


def test_a_short_curve_is_named():
    with pytest.raises(ValueError, match="energy has 300 frames, the dance has 960"):
        choreograph(BEATS, seconds=SECONDS, energy=np.full(300, 0.5))
