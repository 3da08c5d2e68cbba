import importlib.util
import json
import pickle

import pytest
import torch

from dancediff.axes import FPS
from dancediff.data.cmu import LEAD, cmu_jobs
from places import DATA_PREP


@pytest.fixture(scope="module")
def folder(real_data):
    if not (real_data / "cmu" / "manifest.json").is_file():
        pytest.skip(f"no cmu/manifest.json in {real_data}")
    return real_data / "cmu"


@pytest.fixture(scope="module")
def takes(folder):
    return {job.name: job.make() for job in cmu_jobs(folder)}


def test_eleven_duets_and_six_solos(takes, folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    assert sum(take.motion.num_dancers == 2 for take in takes.values()) == 11
    assert sum(take.motion.num_dancers == 1 for take in takes.values()) == 6
    for row in manifest["salsa"]["pairs"]:
        take = takes[f"salsa_{row['take']:02d}"]
        assert take.split == row["split"]
        assert take.motion.num_frames == pytest.approx((row["frames"] - LEAD) / 60 * FPS, abs=2)
    assert {take.split for take in takes.values()} == {"train", "val"}


def test_says_where_everything_comes_from(takes):
    take = takes["salsa_01"]
    assert (take.kind, take.music, take.group) == ("real", "none", "salsa_01")
    assert take.genre == "captured_salsa", "the choreographer's salsa is another genre"
    assert "mocap.cs.cmu.edu" in take.source
    assert "resold" in take.licence
    assert json.loads(json.dumps(take.notes)) == take.notes


def test_feet_stand_and_limbs_point_as_in_the_source(takes):
    for take in takes.values():
        notes = take.notes
        assert abs(notes["skating"] - notes["skating_source"]) < 0.03, take.name
        assert notes["direction_error"] < 5, take.name
        for dancer in notes["dancers"]:
            assert abs(dancer["skating"] - dancer["skating_source"]) < 0.03, take.name
            assert dancer["penetration_p95"] < 0.03, take.name
            assert -0.01 < dancer["lowest_median"] < 0.06, take.name


def test_known_glitches_are_repaired(takes, folder):
    manifest = json.loads((folder / "manifest.json").read_text())
    for row in manifest["salsa"]["pairs"]:
        done = takes[f"salsa_{row['take']:02d}"].notes["dancers"][0]["repairs"]
        body = [entry for entry in done if entry["joint"] == "body"]
        for first, last in row["spike_frames_a"]:
            assert any(e["first"] <= last and e["last"] >= first for e in body), row["take"]


def test_nobody_jumps_and_no_joint_flips(takes):
    for take in takes.values():
        speed = take.motion.root.diff(dim=1).norm(dim=-1) * FPS
        assert speed.max() < 4, take.name
        for R in (take.motion.pose[:, :, j] for j in (0, 3, 15, 20, 21)):
            turn = R[:, 1:].mT @ R[:, :-1]
            cos = ((turn.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2).clamp(-1, 1)
            assert torch.rad2deg(cos.acos()).max() < 70, take.name


def test_partners_dance_with_each_other_in_one_world(takes):
    for name in (name for name in takes if name.startswith("salsa")):
        root = takes[name].motion.root[..., (0, 2)]
        apart = (root[0] - root[1]).norm(dim=-1)
        assert 0.2 < apart.min(), name
        assert 0.5 < apart.median() < 1, name
        assert root.mean((0, 1)).abs().max() < 1e-3, name
        side = (root[0] - root[1])[:, 0]
        assert side.min() < 0 < side.max(), name  # they change sides


def test_jobs_travel_to_other_processes(folder):
    job = pickle.loads(pickle.dumps(cmu_jobs(folder)[-1]))
    assert job.make().name == job.name == "indian_15"


def test_the_script_shows_every_step_and_draws(folder, tmp_path, capsys):
    path = DATA_PREP / "cmu.py"
    spec = importlib.util.spec_from_file_location("prepare_cmu", path)
    script = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(script)
    script.one_take(folder)
    assert "2243 frames" in capsys.readouterr().out
    picture = script.draw_take(folder, "salsa_10", tmp_path / "a.png")
    assert picture.stat().st_size > 20_000


def test_a_folder_without_manifest_is_refused(tmp_path):
    with pytest.raises(ValueError, match=r"manifest\.json"):
        cmu_jobs(tmp_path)
    (tmp_path / "manifest.json").write_text("[1")
    with pytest.raises(ValueError, match=r"manifest\.json"):
        cmu_jobs(tmp_path)
    (tmp_path / "manifest.json").write_text('{"source": "a", "licence": "b", "salsa": {}}')
    with pytest.raises(ValueError, match="indian"):
        cmu_jobs(tmp_path)
    (tmp_path / "manifest.json").write_text(
        '{"source": "a", "licence": "b", "salsa": {"pairs": [{}]}, "indian": {}}'
    )
    with pytest.raises(ValueError, match="fps_true"):
        cmu_jobs(tmp_path)


def test_a_missing_or_broken_file_is_named_when_the_take_is_made(tmp_path):
    solo = {"take": 4, "file": "indian/04.bvh", "split": "train"}
    manifest = {
        **{"source": "a", "licence": "b", "salsa": {"fps_true": 60, "pairs": []}},
        "indian": {"fps_true": 120, "takes": [solo]},
    }
    (tmp_path / "manifest.json").write_text(json.dumps(manifest))
    (job,) = cmu_jobs(tmp_path)
    with pytest.raises(ValueError, match=r"04\.bvh"):
        job.make()
    (tmp_path / "indian").mkdir()
    (tmp_path / "indian" / "04.bvh").write_text("HIERARCHY\n")
    with pytest.raises(ValueError, match=r"04\.bvh.*cut off"):
        job.make()
