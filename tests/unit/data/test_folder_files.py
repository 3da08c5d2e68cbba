"""Files of every kind in one folder: which are one take, and what comes out of each."""

import json
import pickle
import runpy
from dataclasses import replace

import numpy as np
import pytest
import torch

from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.data.folder.gltf import read_gltf
from dancediff.data.folder.posture import Given
from dancediff.data.folder.smpl import read_smpl
from dancediff.data.folder.takes import takes_in
from dancediff.data.prepared import PreparedData
from dancediff.data.take import DanceTake
from dancediff.data.take_file import write_take
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import matrix_to_axis_angle
from dancediff.music.song import Music
from places import DATA_PREP


@pytest.fixture(scope="module")
def duo():
    return choreograph(np.arange(0.2, 5, 0.5), dancers=2, seed=4)[0]


def amass(motion: Motion, path, **more):
    """A file in AMASS's layout, of one dancer, y up."""
    v = matrix_to_axis_angle(motion.pose[0]).flatten(1).numpy()
    np.savez_compressed(path, poses=v, trans=motion.root[0].numpy(), gender="female", **more)


def placed(motion: Motion):
    """Joints with the take's middle at the origin, dancer after dancer."""
    middle = motion.root.mean((0, 1)) * torch.tensor([1.0, 0.0, 1.0])
    return motion.joints() - middle


def test_every_kind_of_file_gives_the_same_dance(duo, tmp_path):
    src, out = tmp_path / "src", tmp_path / "out"
    src.mkdir()
    pytest.importorskip("pygltflib")
    solo = duo.dancer(0)
    duo.save(src / "own.npz")
    duo.save(src / "parts.glb")
    duo.save(src / "skin.glb", body="mesh")
    solo.save(src / "viewer.smpl.npz")  # z up
    solo.save(src / "bones.bvh")
    amass(solo, src / "amass.npz", mocap_framerate=30.0)
    v = matrix_to_axis_angle(duo.pose).flatten(2).numpy()
    content = {"smpl_poses": v, "root_trans": duo.root.numpy()}
    (src / "pickled.pkl").write_bytes(pickle.dumps(content))
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    data = PreparedData(out)
    assert len(data) == 7 and data.skipped == []
    for entry in data:
        expected = placed(duo if entry.dancers == 2 else solo)
        joints = placed(data.load(entry).motion)
        f = min(joints.shape[1], expected.shape[1])
        off = (joints[:, :f] - expected[:, :f]).norm(dim=-1)
        assert off.quantile(0.99) < 0.02, (entry.name, off.max())
    dancers = {entry.name: entry.dancers for entry in data}
    assert dancers["own"] == dancers["parts"] == dancers["skin"] == dancers["pickled"] == 2
    doubts = {entry.name: entry.notes["doubts"] for entry in data}
    assert "no frame rate" in doubts["pickled"][0] and doubts["amass"] == []


def test_a_song_of_the_same_name_belongs_to_a_take(duo, tmp_path):
    src, out = tmp_path / "src", tmp_path / "out"
    (src / "songs").mkdir(parents=True)
    duo.save(src / "waltz.npz")
    duo.save(src / "alone.npz")
    click = np.sin(np.arange(5 * 15360) / 9) * (np.arange(5 * 15360) % 7680 < 900)
    import soundfile

    soundfile.write(src / "songs" / "waltz.wav", click.astype(np.float32), 15360)
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    data = PreparedData(out)
    waltz, alone = data.load("waltz"), data.load("alone")
    assert waltz.music == "original" and waltz.notes["song"] == "waltz.wav"
    assert alone.music == "beat-aligned synthetic"
    assert waltz.M.shape[0] == waltz.num_frames
    assert Music.load(src / "songs" / "waltz.wav").duration == pytest.approx(5)


def test_what_no_person_danced_is_not_real(duo, tmp_path):
    """A dance says in its file what made it: a model, the choreographer, a take of another kind."""
    src, out = tmp_path / "src", tmp_path / "out"
    src.mkdir()
    duo.save(src / "choreographed.npz")
    replace(duo, meta={"model": "tcdiffpp"}).save(src / "generated.npz")
    replace(duo, meta={}).save(src / "captured.npz")
    take = DanceTake("composed", replace(duo, meta={}), kind="composed", music="none")
    write_take(src / "composed.npz", take)
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    kinds = {entry.name: entry.kind for entry in PreparedData(out)}
    assert kinds == {
        "choreographed": "synthetic",
        "generated": "synthetic",
        "captured": "real",
        "composed": "composed",
    }


def test_names_or_a_table_tell_who_danced_together(duo, tmp_path):
    src = tmp_path
    (src / "sub").mkdir()
    for name in ("a_1", "a_2", "sub/b_1", "sub/b_2", "solo"):
        duo.dancer(0).save(src / f"{name}.npz")
    grouped = takes_in(src, group="{take}_{dancer}")
    assert {plan.name: len(plan.files) for plan in grouped} == {"a": 2, "sub_b": 2, "solo": 1}
    assert len(takes_in(src)) == 5
    (src / "takes.toml").write_text(
        '[[take]]\nname = "both"\nfiles = ["a_1.npz", "sub/b_1.npz"]\nfps = 60\nsplit = "val"\n'
    )
    plans = {plan.name: plan for plan in takes_in(src, given=Given(up="z"))}
    assert plans["both"].given == Given(up="z", fps=60) and plans["both"].split == "val"
    assert set(plans) == {"both", "a_2", "sub_b_2", "solo"}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("take = 1", "[[take]]"),
        ("[[take]]", "files=None"),
        ('[[take]]\nfiles = ["no.bvh"]', "no.bvh' is not there"),
        ('[[take]]\nfiles = ["a.npz"]\nspeed = 1', "'speed' is unknown"),
        ('[[take]]\nfiles = ["a.npz"]\nup = "w"', "up='w'"),
        ('[[take]]\nfiles = ["a.npz"]\nfps = -1', "fps=-1"),
        ('[[take]]\nfiles = ["a.npz"]\nrest = "T"', "rest='T'"),
        ('[[take]]\nfiles = ["a.npz"]\nsplit = "half"', "split='half'"),
        ('[[take]]\nfiles = ["a.npz"]\ngenre = 3', "genre=3"),
    ],
)
def test_wrong_tables_name_what_is_wrong(duo, tmp_path, capsys, text, words):
    duo.save(tmp_path / "a.npz")
    (tmp_path / "takes.toml").write_text(text)
    assert main(["prepare", "folder", str(tmp_path), str(tmp_path / "out")]) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(
    ("args", "words"),
    [
        (["--group", "{take}"], "group='{take}'"),
        (["--unit", "0"], "unit=0.0"),
        (["--seed", "3"], "seed=3 is no option of folder"),
    ],
)
def test_wrong_options(duo, tmp_path, capsys, args, words):
    duo.save(tmp_path / "a.npz")
    assert main(["prepare", "folder", str(tmp_path), str(tmp_path / "out"), *args]) == 2
    assert words in capsys.readouterr().err
    assert main(["prepare", "folder", str(tmp_path / "out2"), str(tmp_path / "out")]) == 2


def test_the_script_shows_the_same_steps(duo, tmp_path, monkeypatch, capsys):
    src = tmp_path / "src"
    src.mkdir()
    duo.dancer(0).save(src / "solo.bvh")
    script = DATA_PREP / "folder.py"
    monkeypatch.setattr("sys.argv", [str(script), str(src), str(tmp_path / "out")])
    runpy.run_path(str(script), run_name="__main__")
    told = capsys.readouterr().out
    assert "solo.bvh: " in told and "'map': 'generic'" in told and "made 1, kept 0" in told


def test_an_empty_folder_is_refused(tmp_path, capsys):
    assert main(["prepare", "folder", str(tmp_path), str(tmp_path / "out")]) == 2
    assert "holds no .bvh" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arrays", "words"),
    [
        ({"trans": np.zeros((9, 3))}, "it lacks poses"),
        ({"poses": np.zeros((9, 66))}, "it lacks trans"),
        ({"poses": np.zeros((9, 60)), "trans": np.zeros((9, 3))}, "poses have 60 numbers"),
        ({"poses": np.zeros((9, 66)), "trans": np.zeros((9, 2))}, "trans has shape"),
        ({"root_orient": np.zeros((9, 3)), "trans": np.zeros((9, 3))}, "lacks pose_body"),
        (
            {"poses": np.zeros((9, 66)), "trans": np.zeros((9, 3)), "fps": np.array("fast")},
            "fps is no single positive number",
        ),
    ],
)
def test_what_an_smpl_file_lacks(tmp_path, arrays, words):
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=words):
        read_smpl(tmp_path / "a.npz")


def test_amass_in_two_parts(duo, tmp_path):
    v = matrix_to_axis_angle(duo.pose[0]).flatten(1).numpy()
    parts = {"root_orient": v[:, :3], "pose_body": v[:, 3:66], "trans": duo.root[0].numpy()}
    np.savez(tmp_path / "a.npz", mocap_frame_rate=np.array(30.0), **parts)
    motion, tells = read_smpl(tmp_path / "a.npz")
    assert tells and torch.allclose(motion.joints(), duo.dancer(0).joints(), atol=1e-5)


def test_a_pickle_that_runs_something_is_refused(tmp_path, capsys):
    class Evil:
        def __reduce__(self):
            return print, ("run",)

    (tmp_path / "evil.pkl").write_bytes(pickle.dumps({"poses": Evil()}))
    assert main(["prepare", "folder", str(tmp_path), str(tmp_path / "out")]) == 1
    told = capsys.readouterr()
    assert "evil.pkl" in told.err and "run" not in told.out.split()


def gltf(tmp_path, change):
    """A .gltf of a dance, changed, with its numbers beside it."""
    pytest.importorskip("pygltflib")
    from dancediff.data.folder.gltf import chunks

    motion = choreograph(np.arange(0.2, 3, 0.5), dancers=1, seed=1)[0]
    book, blob = chunks(motion.save(tmp_path / "a.glb").read_bytes())
    book["buffers"][0]["uri"] = "a.bin"
    (tmp_path / "a.bin").write_bytes(blob)
    change(book)
    (tmp_path / "a.gltf").write_text(json.dumps(book))
    return motion, tmp_path / "a.gltf"


def test_gltf_with_its_numbers_beside_it_and_a_scale_above(tmp_path):
    def shrink(book):
        root = book["scenes"][0]["nodes"][0]
        book["nodes"].append({"name": "Armature", "scale": [0.5] * 3, "children": [root]})

    motion, path = gltf(tmp_path, shrink)
    (bvh,) = read_gltf(path)
    points = bvh.world()[0].float()
    assert torch.allclose(2 * points, motion.joints()[0][: len(points)], atol=1e-3)


def step(book):
    for sampler in book["animations"][0]["samplers"]:
        sampler["interpolation"] = "STEP"


def test_steps_hold_their_values(tmp_path):
    motion, path = gltf(tmp_path, step)
    (bvh,) = read_gltf(path)
    assert torch.allclose(bvh.root[5].float(), motion.root[0, 5], atol=1e-4)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda book: book["animations"].clear(), "no animation"),
        (lambda book: book["nodes"][3].update(children=[0]), "no trees"),
        (lambda book: book["accessors"][book["animations"][0]["samplers"][0]["input"]].update(
            count=10**9), "does not lie in the file"),
        (lambda book: book["accessors"][book["animations"][0]["samplers"][0]["input"]].update(
            sparse={}), "sparse or compressed"),
        (lambda book: book["buffers"][0].update(uri="../a.bin"), "another folder"),
        (lambda book: book["nodes"][0].update(scale=[-1, 1, 1]), "mirrored"),
        (lambda book: book.pop("nodes"), "damaged"),
    ],
)  # fmt: skip
def test_damaged_gltf_is_refused(tmp_path, change, words):
    _, path = gltf(tmp_path, change)
    with pytest.raises(ValueError, match=words):
        read_gltf(path)
