"""`dancediff evaluate` and its Python form: right numbers, honest gaps, clear errors."""

import itertools
import json
import math
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import dancediff
from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.data.take import DanceTake
from dancediff.data.take_file import write_take
from dancediff.metrics import report as report_module
from dancediff.metrics import rows as rows_module
from dancediff.metrics.bootstrap import bootstrap_interval
from dancediff.metrics.collision import tif
from dancediff.metrics.corruption import freeze
from dancediff.metrics.dances import find_dances, read_dance, told_apart
from dancediff.metrics.fidelity import diversity, fid
from dancediff.metrics.geometric import geometric_features
from dancediff.metrics.group import gmc, gmr, group_features
from dancediff.metrics.kinetic import kinetic_features
from dancediff.metrics.measure import Measured, measure
from dancediff.metrics.physical import below_floor, fsr, pfc
from dancediff.metrics.report import evaluate, evaluate_dances
from dancediff.metrics.rhythm import beat_alignment
from dancediff.metrics.rows import METRICS, table_rows
from dancediff.motion.motion import Motion

BEATS = np.arange(0.4, 3.0, 0.4)
FRAMES = 90


def trio(seed: int, **options) -> Motion:
    options = {"dancers": 3, "seconds": FRAMES / 30} | options
    return choreograph(np.arange(0.4, 6, 0.4), seed=seed, **options)[0]


def take_of(motion: Motion, name: str, kind: str = "synthetic", beats=BEATS) -> DanceTake:
    words = {"music": "none", "source": "s", "licence": "l", "split": "val", "group": name}
    return DanceTake(name=name, dance=motion, kind=kind, beats=beats, **words)


@pytest.fixture(scope="module")
def dances() -> list[Motion]:
    return [trio(seed) for seed in range(4)]


@pytest.fixture(scope="module")
def others() -> list[Motion]:
    return [trio(seed) for seed in range(100, 105)]


@pytest.fixture
def files(dances, tmp_path):
    for k, dance in enumerate(dances):
        dance.save(tmp_path / f"d{k}.npz")
    return tmp_path


def pieces(dance: Motion, size: int) -> list[Motion]:
    starts = range(0, dance.num_frames - size + 1, size)
    return [dance.frames(start, start + size) for start in starts]


@pytest.mark.parametrize("window", [None, 40])
def test_values_are_those_of_the_metrics(dances, others, window):
    report = evaluate_dances(dances, reference=others, song=BEATS, window=window)
    size = window or FRAMES
    cut = [p.joints() for dance in dances for p in pieces(dance, size)]
    real = [p.joints() for dance in others for p in pieces(dance, size)]
    assert len(cut) == 4 * (FRAMES // size)
    times = [BEATS - start / 30 for _ in dances for start in range(0, FRAMES - size + 1, size)]
    k, k_real = (torch.cat([kinetic_features(x) for x in side]) for side in (cut, real))
    g, g_real = (torch.cat([geometric_features(x) for x in side]) for side in (cut, real))
    groups, groups_real = (torch.stack([group_features(x) for x in side]) for side in (cut, real))

    def rhythm(direction):
        pairs = zip(cut, times, strict=True)
        return np.mean([beat_alignment(x, b, direction=direction) for x, b in pairs])

    expected = {
        "FID_k": fid(k, k_real),
        "FID_g": fid(g, g_real),
        "Div_k": diversity(k, k_real),
        "Div_g": diversity(g, g_real),
        "GMR": gmr(groups, groups_real),
        "GMC": np.mean([gmc(x) for x in cut]),
        "TIF": np.mean([tif(x) for x in cut]),
        "MMC": rhythm("motion"),
        "BAS": rhythm("music"),
        "PFC": np.mean([pfc(x) for x in cut]),
        "FSR": np.mean([fsr(x) for x in cut]),
        "below the floor": np.mean([below_floor(x) for x in cut]),
        "joint speed": np.mean([30 * x.diff(dim=1).norm(dim=-1).mean() for x in cut]),
    }
    for name, value in expected.items():
        assert report[name].value == pytest.approx(value, rel=1e-5), name
        assert report[name].n == 4
        assert report[name].low <= report[name].value <= report[name].high, name
    assert report["Div_k"].reference == pytest.approx(diversity(k_real, k_real))
    assert report["GMC"].reference == pytest.approx(np.mean([gmc(x) for x in real]))
    assert report["GMR"].samples == len(cut) and report["FID_k"].samples == 3 * len(cut)
    assert report["abrupt swaps"].samples == 4  # of whole dances, however they are cut


def measured(name: str, numbers: list[float], fps: float = 30.0, **more) -> Measured:
    return Measured(name, "real", fps, 3, 900, numbers={"GMC": numbers, "TIF": [0.0]}, **more)


def test_the_bootstrap_draws_dances_and_not_windows():
    means = [1.0, 2.0, 5.0, 9.0, 11.0]
    whole = [measured(f"d{k}", [m]) for k, m in enumerate(means)]
    cut = [measured(f"d{k}", [m] * 50) for k, m in enumerate(means)]
    a, b = ({row.name: row for row in table_rows(side, None)}["GMC"] for side in (whole, cut))
    assert (a.low, a.high) == pytest.approx((b.low, b.high))
    assert (a.low, a.high) == pytest.approx(bootstrap_interval(np.mean, np.array(means)))
    assert (b.n, b.samples) == (5, 250)


def test_one_dance_has_no_interval(dances):
    row = evaluate_dances(dances[0])["GMC"]
    assert row.low is None and row.high is None and math.isfinite(row.value)


def test_files_folders_and_motions_give_the_same(dances, files):
    direct = evaluate_dances(dances, song=BEATS)
    for sources in (files, [files / f"d{k}.npz" for k in range(4)], [files, files / "d1.npz"]):
        for row in evaluate_dances(sources, song=BEATS).rows:
            # a file keeps two of the three columns of each rotation, which rounds
            assert row.value == pytest.approx(direct[row.name].value, rel=1e-3, nan_ok=True)
            assert row.n == direct[row.name].n


def test_beats_of_the_file_come_first(dances, tmp_path):
    (tmp_path / "takes").mkdir()
    own = write_take(tmp_path / "takes" / "own.npz", take_of(dances[0], "own"))
    none = write_take(tmp_path / "takes" / "none.npz", take_of(dances[1], "none", beats=None))
    wrong = BEATS + 0.2
    both = [
        beat_alignment(dances[0].joints(), BEATS),
        beat_alignment(dances[1].joints(), wrong),
    ]
    assert evaluate_dances([own, none], song=wrong)["BAS"].value == pytest.approx(np.mean(both))
    row = evaluate_dances([own, none])["BAS"]
    assert row.n == 1 and row.value == pytest.approx(both[0])
    assert "1 of 2 left out: no beats" in row.reason


def test_a_take_in_capitals_keeps_its_facts(dances, tmp_path):
    """Of .NPZ the dance was read, its beats, kind and genre were not."""
    (tmp_path / "takes").mkdir()
    path = write_take(tmp_path / "takes" / "own.npz", take_of(dances[0], "own", kind="composed"))
    loud = read_dance(path.rename(tmp_path / "OWN.NPZ"))
    assert loud.kind == "composed" and np.array_equal(loud.beats, BEATS)


def test_one_song_for_each_dance(dances):
    songs = [BEATS, BEATS + 0.1, BEATS, BEATS + 0.15]
    pairs = zip(dances, songs, strict=True)
    expected = np.mean([beat_alignment(d.joints(), s) for d, s in pairs])
    assert evaluate_dances(dances, song=songs)["BAS"].value == pytest.approx(expected)
    with pytest.raises(ValueError, match="2 songs for 4 dances"):
        evaluate_dances(dances, song=songs[:2])


def test_swap_obedience_is_that_of_the_swap_asked_for(dances):
    x = torch.zeros(3, FRAMES, 3)
    x[:, :, 0] = torch.tensor([-1.0, 0.0, 1.0])[:, None]
    x[:2, FRAMES // 2 :, 0] = torch.tensor([0.0, -1.0])[:, None]  # the left and middle one trade

    def asked(swap):
        return replace(dances[0], root=x, meta={"swap": swap})

    report = evaluate_dances([asked([1, 0, 2]), asked([0, 1, 2]), asked([0, 2, 1]), dances[1]])
    assert report["swap obedience"].value == pytest.approx(1 / 3)
    assert report["swap obedience"].n == 3 and "1 of 4 left out" in report["swap obedience"].reason
    assert report["swap obedience, neighbours"].value == 0.5
    assert report["swap obedience, identity"].value == 0
    assert report["abrupt swaps"].value == pytest.approx(2 * 3 / 4)
    with pytest.raises(KeyError):
        report["swap obedience, outer"]  # nobody asked
    turned = replace(dances[0], root=x.flip(0), meta={"swap": [2, 1, 0]})  # own numbers, by start=
    assert evaluate_dances(turned)["swap obedience, identity"].n == 1
    bad = evaluate_dances(asked([0, 0, 1]))["swap obedience"]
    assert math.isnan(bad.value) and "swap=[0, 0, 1]" in bad.reason


def spoilt(dance: Motion, frame: int = 5) -> Motion:
    root = dance.root.clone()
    root[0, frame] = math.nan
    return replace(dance, root=root)


def test_nan_is_told_and_not_averaged(dances, others):
    report = evaluate_dances(
        [spoilt(dances[0]), *dances[1:]], reference=[*others, spoilt(others[0])], song=BEATS
    )
    good = evaluate_dances(dances[1:], reference=others, song=BEATS)
    for row in report.rows:
        if row.name.startswith("swap"):
            continue
        assert row.value == pytest.approx(good[row.name].value), row.name
        assert row.n == 3 and "1 of 4 left out: " in row.reason and "NaN" in row.reason
    alone = evaluate_dances(spoilt(dances[0]), song=BEATS)
    assert alone.is_empty and all(row.reason for row in alone.rows)


def test_a_window_with_nan_is_left_out_alone(dances):
    row = evaluate_dances(spoilt(dances[0]), window=30)["GMC"]
    rest = [gmc(p.joints()) for p in pieces(dances[0], 30)[1:]]
    assert row.value == pytest.approx(np.mean(rest)) and row.samples == 2
    assert "1 of 3 left out" in row.reason


def test_one_dancer_has_no_group_numbers(dances, others):
    report = evaluate_dances([d.dancer(0) for d in dances], reference=others, song=BEATS)
    for name in ("GMR", "GMC", "TIF"):
        assert math.isnan(report[name].value) and "1 dancers" in report[name].reason
        assert report[name].n == 0
    assert math.isfinite(report["FID_k"].value)


@pytest.mark.parametrize("frames", [1, 2])
def test_a_dance_may_be_too_short(dances, frames):
    report = evaluate_dances(dances[0].frames(0, frames), song=BEATS)
    for name in ("GMC", "PFC", "BAS"):
        assert math.isnan(report[name].value) and f"{frames} frames" in report[name].reason
    assert math.isfinite(report["TIF"].value)


def test_a_dance_too_long_for_gmc_is_cut_by_a_window(monkeypatch, dances):
    monkeypatch.setattr("dancediff.metrics.measure.LONGEST_GMC", 40)
    row = evaluate_dances(dances[0])["GMC"]
    assert math.isnan(row.value) and "90 frames" in row.reason and "window" in row.reason
    assert evaluate_dances(dances[0], window=40)["GMC"].value > 0


def test_a_dance_may_be_shorter_than_the_window(dances):
    report = evaluate_dances([dances[0], dances[1].frames(0, 20)], window=45)
    assert report["GMC"].n == 1 and "20 frames" in report["GMC"].reason
    report = evaluate_dances(dances[0], window=FRAMES + 1)
    assert math.isnan(report["GMC"].value) and "window of 91" in report["GMC"].reason


def test_frame_rates_are_not_mixed(dances, others):
    fast = replace(dances[0], fps=60.0)
    report = evaluate_dances([fast, *dances[1:]], reference=others, song=BEATS)
    for row in report.rows:
        if next(metric for metric in METRICS if metric.name == row.name).whole:
            continue
        assert math.isnan(row.value) and "30 and 60" in row.reason, row.name
    report = evaluate_dances([fast], reference=others, song=BEATS)
    assert "30 and 60" in report["FID_k"].reason
    assert report["joint speed"].value > 0 and not report["joint speed"].reason


def test_no_reference_no_beats(dances):
    report = evaluate_dances(dances)
    for name in ("FID_k", "FID_g", "Div_k", "Div_g", "GMR"):
        assert math.isnan(report[name].value) and report[name].reason == rows_module.NO_REFERENCE
    for name in ("BAS", "MMC"):
        assert math.isnan(report[name].value) and "no beats" in report[name].reason


def test_a_small_reference_is_told(dances, others):
    report = evaluate_dances(dances, reference=others[0])
    assert math.isnan(report["GMR"].value) and "1 rows" in report["GMR"].reason
    assert "3 samples for 72 dimensions" in report["FID_k"].reason
    assert "12 samples for 72 dimensions" in report["FID_k"].reason
    assert "12 samples for 32 dimensions" in report["FID_g"].reason


def test_the_reference_must_be_another_set(dances, files):
    same = evaluate_dances(files / "d0.npz", reference=files)
    assert any("1 dances are in the reference too" in note for note in same.notes)
    both = evaluate_dances(dances, reference=dances)
    assert both.notes and both["FID_k"].value < 1e-6 and both["FID_k"].low == 0
    assert not evaluate_dances(dances[0], reference=dances[1:]).notes


def test_div_of_many_says_how_many_it_took(monkeypatch, dances, others):
    monkeypatch.setattr(rows_module, "MOST", 6)
    report = evaluate_dances(dances, reference=others)
    assert report["Div_k"].samples == 6 and "of 2 of 4 dances" in report["Div_k"].reason
    assert report["FID_k"].samples == 12


def test_bad_files_are_skipped_and_named(files):
    (files / "broken.npz").write_bytes(b"no motion")
    report = evaluate_dances(files, song=BEATS)
    assert report.dances["count"] == 4 and "broken.npz" in str(report)
    with pytest.raises(ValueError, match=r"none of the 1 dances can be read; .*broken\.npz"):
        evaluate_dances(files / "broken.npz")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"window": 2}, "window=2 must be at least 3"),
        ({"workers": 0}, "workers=0"),
        ({"reference": "nowhere"}, "'nowhere' does not exist"),
        ({"song": "nothing.wav"}, "nothing.wav"),
    ],
)
def test_bad_arguments(dances, options, words):
    with pytest.raises(ValueError, match=words):
        evaluate_dances(dances, **options)


def test_no_dances(tmp_path):
    with pytest.raises(ValueError, match="dances has a Tensor; give each a Motion"):
        evaluate_dances(torch.zeros(2, 9, 24, 3))
    with pytest.raises(ValueError, match="list is empty"):
        find_dances([])
    with pytest.raises(ValueError, match=r"holds no dance"):
        find_dances(tmp_path)
    (tmp_path / "song.wav").write_bytes(b"")
    with pytest.raises(ValueError, match=r"is no dance that can be read"):
        find_dances(tmp_path / "song.wav")


def test_other_formats_are_read_too(dances, tmp_path):
    pytest.importorskip("pygltflib")
    direct = evaluate_dances(dances[:1], song=BEATS)
    for name in ("dance.glb", "other.npz"):
        dances[0].save(tmp_path / name)
        again = evaluate_dances(tmp_path / name, song=BEATS)
        assert again["TIF"].value == direct["TIF"].value
        assert again["FSR"].value == pytest.approx(direct["FSR"].value, abs=0.01)
    dances[0].save(tmp_path / "dance.bvh")
    assert evaluate_dances(tmp_path / "dance.1.bvh").dances["dancers"] == [1]
    assert evaluate_dances(tmp_path).dances["count"] == 2  # dance.glb and other.npz


def test_what_is_kept_of_a_dance_does_not_grow_with_it():
    def size(seconds):
        found = measure(trio(0, seconds=seconds), beats=BEATS)
        arrays = itertools.chain(*found.rows.values())
        return sum(a.nbytes for a in arrays), sum(map(len, found.numbers.values()))

    assert size(3) == size(9)
    assert size(3)[0] < 4096


@pytest.mark.slow
def test_the_number_of_workers_changes_nothing(files):
    one, two = (evaluate_dances(files, song=BEATS, workers=w).to_json() for w in (1, 2))
    assert one == two


def test_json_is_strict_and_whole(dances, tmp_path, monkeypatch):
    report = evaluate_dances(dances, song=BEATS)
    path = report.save(tmp_path / "report.json")
    facts = json.loads(path.read_text(), parse_constant=pytest.fail)
    rows = {row["name"]: row for row in facts["rows"]}
    assert rows["FID_k"]["value"] is None and rows["FID_k"]["reason"]
    assert rows["GMC"]["value"] == report["GMC"].value
    assert facts["level"] == 0.95 and facts["dances"]["count"] == 4

    def half(self):
        raise OSError("disk full")

    monkeypatch.setattr(report_module.Report, "to_json", half)
    with pytest.raises(OSError, match="disk full"):
        report.save(path)
    assert [p.name for p in tmp_path.iterdir()] == ["report.json"]
    assert json.loads(path.read_text()) == facts


def test_the_table_names_what_is_not_real(dances, others):
    kinds = ["composed", "composed", "synthetic", "real"]
    takes = [take_of(d, f"t{k}", kinds[k]) for k, d in enumerate(dances)]
    report = evaluate_dances(takes, reference=others)
    text = str(report)
    lines = text.splitlines()
    assert any("2 composed" in line and line.endswith("t0, t1") for line in lines)
    assert any("1 synthetic" in line and line.endswith("t2") for line in lines)
    assert any("5 synthetic" in line for line in lines if not line.startswith("reference"))
    row = next(line for line in lines if line.startswith("FID_k"))
    assert "↓" in row and "…" in row and row.endswith("(1)")
    assert "as the reference" in next(line for line in lines if line.startswith("Div_k"))
    assert "↑" in next(line for line in lines if line.startswith("BAS"))
    assert "(1) dances: 12 samples for 72 dimensions" in text
    named = {"composed": ["t0", "t1"], "synthetic": ["t2"], "real": ["t3"]}
    assert report.dances["names"] == named


def test_evaluate_needs_no_reference(dances):
    report = dancediff.evaluate(dances[0], BEATS)
    names = [row.name for row in report.rows]
    assert names[:7] == ["GMC", "unison", "TIF", "MMC", "BAS", "PFC", "FSR"]
    assert not {m.name for m in METRICS if m.compare} & set(names)
    assert report["BAS"].value == pytest.approx(beat_alignment(dances[0].joints(), BEATS))
    assert evaluate is dancediff.evaluate


def test_evaluate_takes_one_dance(dances):
    with pytest.raises(ValueError, match=r"list of 4; give one, or call .*evaluate_dances"):
        dancediff.evaluate(dances)


def test_the_command_prints_and_writes(files, capsys):
    out = files / "new" / "report.json"
    args = [str(files), "--workers", "1", "--window", "30"]
    assert main(["evaluate", *args]) == 0
    printed = capsys.readouterr()
    assert "windows of 30 frames" in printed.out and "BAS" in printed.out
    assert "4/4" in printed.err and "4/4" not in printed.out  # the progress bar
    assert main(["evaluate", *args, "--out", str(out), "--song", "packaged", "--json"]) == 0
    printed = capsys.readouterr()
    facts = json.loads(printed.out)
    assert facts == json.loads(out.read_text()) and not printed.err
    bas = next(row for row in facts["rows"] if row["name"] == "BAS")
    assert bas["samples"] == 12 and bas["value"] > 0


@pytest.mark.parametrize(
    ("args", "status", "words"),
    [
        (["nowhere.npz"], 2, ["nowhere.npz", "does not exist"]),
        ([], 2, ["evaluate", "name dances"]),
        (["broken.npz"], 2, ["broken.npz", "no dancediff motion"]),
        (["d0.npz", "--window", "2"], 2, ["window=2"]),
        (["d0.npz", "--window", "x"], 2, ["--window 'x'", "whole number"]),
        (["d0.npz", "--out", "."], 2, ["--out", "folder"]),
        (["d0.npz", "--song", "broken.npz"], 2, ["broken.npz", "sound"]),
        (["d0.npz", "--reference", "nowhere"], 2, ["nowhere", "does not exist"]),
        (["nan.npz", "--workers", "1"], 1, ["no metric could be computed"]),
    ],
)
def test_the_command_fails_clearly(dances, files, capsys, monkeypatch, args, status, words):
    monkeypatch.chdir(files)
    (files / "broken.npz").write_bytes(b"no motion")
    with np.load(files / "d0.npz") as good:  # save refuses such a dance, so other software wrote it
        arrays = dict(good)
    arrays["root"] = np.full_like(arrays["root"], np.nan)
    np.savez(files / "nan.npz", **arrays)
    assert main(["evaluate", *args]) == status
    last = capsys.readouterr().err.strip().splitlines()[-1]
    assert last.startswith("dancediff: ") and all(word in last for word in words), last


def test_two_dancers_exchanged_at_a_seam_are_counted_only_where_the_dance_has_one():
    root = torch.zeros(2, 60, 3)
    root[:, :, 1] = 0.95
    root[0, :, 0], root[1, :, 0] = -0.15, 0.15
    root[:, 30:] = root[:, 30:].flip(0)  # 30 cm in a frame would be a jump, so spread it out
    for f in range(27, 33):
        root[0, f, 0] = -0.15 + 0.3 * (f - 26.5) / 6
    root[1, :, 0] = -root[0, :, 0]
    pose = torch.eye(3).expand(2, 60, 24, 3, 3).clone()
    for seams, count in (([], 0.0), ([30], 1.0), ([10], 0.0)):
        dance = Motion(pose, root.clone(), meta={"seams": seams})
        assert evaluate(dance)["abrupt swaps"].value == count


def test_a_pipe_is_refused_at_once(tmp_path):
    os.mkfifo(tmp_path / "dance.npz")
    with pytest.raises(ValueError, match="is no regular file"):
        evaluate_dances(tmp_path / "dance.npz")


def test_a_dance_that_settles_drifts_and_leaves_the_range_of_its_genre():
    options = {"dancers": 2, "seconds": 20.0, "genre": "house"}
    beats = np.arange(0.4, 20, 0.5)
    good = [choreograph(beats, seed=seed, **options)[0] for seed in range(14)]
    takes = [replace(take_of(d, f"t{k}"), genre="house") for k, d in enumerate(good[4:])]
    slow = {"dancers": 2, "seconds": 20.0, "genre": "contemporary"}
    takes += [
        replace(take_of(choreograph(beats, seed=s, **slow)[0], f"c{s}"), genre="contemporary")
        for s in range(20, 30)
    ]
    settled = [freeze(d, 0.5, np.random.default_rng(0)) for d in good[:4]]
    tables = {}
    for name, dances in (("good", good[:4]), ("settled", settled)):
        named = [replace(take_of(d, f"{name}{k}"), genre="house") for k, d in enumerate(dances)]
        tables[name] = evaluate_dances(named, reference=takes)
    assert tables["settled"]["turning, last / first"].value == 0
    assert 0.8 < tables["good"]["knee bend, last / first"].value < 1.25
    for posture in ("turning", "stillness", "standing"):
        name = f"{posture}, in range"
        assert tables["settled"][name].value <= tables["good"][name].value - 0.2, name
    assert tables["good"]["knee bend, in range"].value > 0.6
    other = [replace(take_of(d, f"o{k}"), genre="contemporary") for k, d in enumerate(good[:4])]
    knees = evaluate_dances(other, reference=takes)["knee bend, in range"].value
    assert knees < tables["good"]["knee bend, in range"].value  # a house dance asked for as slow
    short = evaluate_dances([good[0].frames(0, 90)])
    assert not any("last / first" in row.name or "in range" in row.name for row in short.rows)


def test_a_table_leaves_its_dances_as_they_are():
    dances = [measure(trio(seed, seconds=6.0)) for seed in range(2)]
    before = list(table_rows(dances, None))
    assert any(row.name.endswith("in range") for row in table_rows(dances, dances))
    assert [row.name for row in table_rows(dances, None)] == [row.name for row in before]


def test_a_ratio_with_nothing_in_the_first_window_has_a_reason():
    still = Motion(torch.eye(3).expand(1, 300, 24, 3, 3), torch.zeros(1, 300, 3))
    walk = torch.arange(300.0)[None, :, None] * torch.tensor([0.01, 0.0, 0.0])
    walking = Motion(still.pose, walk)
    row = evaluate_dances([walking, walking])["standing, last / first"]
    assert math.isnan(row.value) and "no ratio" in row.reason
    row = evaluate_dances([still, walking])["standing, last / first"]
    assert row.value == 1 and row.low == row.high == pytest.approx(1)  # of draws that have a ratio


@pytest.mark.parametrize("dance", [None, 3])
def test_what_is_no_dance_is_named(dance):
    with pytest.raises(ValueError, match=rf"dance is a {type(dance).__name__}; give a Motion"):
        evaluate(dance)


def test_a_window_of_no_whole_frames_is_named():
    dance = Motion(torch.eye(3).expand(1, 9, 24, 3, 3), torch.zeros(1, 9, 3))
    with pytest.raises(ValueError, match=r"window=60\.0 must be an integer, .* or None"):
        evaluate_dances([dance], window=60.0)


def test_dances_of_one_name_are_told_apart_by_their_folders(dances, tmp_path):
    files = ["one/dance.npz", "sub/one/dance.npz", "two/dance.npz"]
    for dance, name in zip(dances, files, strict=False):
        dance.save(tmp_path / name)
    names = evaluate_dances([tmp_path]).dances["names"]
    assert sorted(name for some in names.values() for name in some) == ["one", "sub/one", "two"]
    paths = [Path("a.npz"), Path("a.glb"), Path("a/dance.npz")]
    assert told_apart(["a"] * 3, paths) == ["a.npz", "a.glb", "a/dance.npz"]
