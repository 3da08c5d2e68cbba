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
from dancediff.data.folder import make
from dancediff.data.folder.gltf import read_gltf
from dancediff.data.folder.make import read_file
from dancediff.data.folder.posture import Given
from dancediff.data.folder.prepare import one_split_a_song
from dancediff.data.folder.settings import read_checked, write_settings
from dancediff.data.folder.smpl import read_smpl
from dancediff.data.folder.takes import TakePlan, takes_in
from dancediff.data.folder.upright import standing
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


def test_formats_of_one_dance_are_one_take(duo, tmp_path):
    """They were takes of their own, some in train and some in val."""
    for end in ("npz", "glb", "bvh", "smpl.npz"):
        duo.save(tmp_path / f"dance.{end}")
    with pytest.warns(UserWarning, match=r"in other formats: dance.1.bvh, .*dance.2.smpl.npz, dan"):
        (plan,) = takes_in(tmp_path)
    assert plan.labels == ("dance.npz",)
    for path in tmp_path.glob("dance.[ng]*"):
        path.unlink()
    with pytest.warns(UserWarning, match=r"dance.1.bvh, dance.2.bvh"):
        (plan,) = takes_in(tmp_path, group="{take}.{dancer}")
    assert plan.labels == ("dance.1.smpl.npz", "dance.2.smpl.npz") and plan.name == "dance"


def test_exports_of_a_dance_that_nobody_danced_are_not_real(duo, tmp_path):
    src, out = tmp_path / "src", tmp_path / "out"
    src.mkdir()
    solo = duo.dancer(0)
    assert solo.is_synthetic and not replace(solo, meta={}).is_synthetic
    solo.save(src / "arrays.smpl.npz")
    solo.save(src / "scene.glb")
    replace(solo, meta={}).save(src / "danced.glb")
    solo.save(src / "tree.bvh")
    (src / "takes.toml").write_text('[[take]]\nfiles = ["tree.bvh"]\nkind = "synthetic"\n')
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    kinds = {entry.name: entry.kind for entry in PreparedData(out)}
    made = dict.fromkeys(("arrays", "scene", "tree"), "synthetic")
    assert kinds == made | {"danced": "real"}


def test_exports_of_a_prepared_take_that_nobody_danced_are_not_real(duo, tmp_path):
    """A take of a folder lost the mark, so its exports counted as captures."""
    src, out = tmp_path / "src", tmp_path / "out"
    src.mkdir()
    duo.dancer(0).save(src / "made.npz")
    replace(duo.dancer(0), meta={}).save(src / "danced.npz")
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    for name, kind in (("made", "synthetic"), ("danced", "real")):
        take = Motion.load(out / "takes" / f"{name}.npz")
        assert take.is_synthetic == (kind == "synthetic")
        for end in ("glb", "smpl.npz"):
            assert make.told_kind(take.save(tmp_path / f"{name}.{end}")) == kind


def test_the_report_says_that_a_bvh_cannot_say_who_danced_it(duo, tmp_path):
    src, out = tmp_path / "src", tmp_path / "out"
    src.mkdir()
    duo.dancer(0).save(src / "tree.bvh")
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    assert [entry.kind for entry in PreparedData(out)] == ["real"]
    said = (out / "report.md").read_text(encoding="utf-8").splitlines()[-1]
    assert said.startswith("A .bvh file cannot say who danced it") and "takes.toml" in said
    (src / "takes.toml").write_text('[[take]]\nfiles = ["tree.bvh"]\nkind = "synthetic"\n')
    assert main(["prepare", "folder", str(src), str(tmp_path / "again")]) == 0
    assert "cannot say" not in (tmp_path / "again" / "report.md").read_text(encoding="utf-8")


def test_names_or_a_table_tell_who_danced_together(duo, tmp_path):
    src = tmp_path
    (src / "sub").mkdir()
    for name in ("a_1", "a_2", "sub/b_1", "sub/b_2", "solo"):
        duo.dancer(0).save(src / f"{name}.npz")
    with pytest.warns(UserWarning, match=r"group='{take}_{dancer}' does not fit solo.npz; each"):
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
    ("group", "names", "take"),
    [
        ("{take}_{dancer}", ["duo_José", "duo_anna"], "duo"),
        ("{take}_{dancer}", ["duo_Jose\u0301", "duo_さくら"], "duo"),  # e, and its accent
        ("{take}_{dancer}", ["duo_Anne-Marie", "duo_b-2"], "duo"),
        ("{dancer}_{take}", ["Anne-Marie_duo", "ben_duo"], "duo"),
        ("{dancer}-{take}", ["anna-b-duo", "ben-b-duo"], "b-duo"),  # the first hyphen parts them
        ("{take}-{dancer}", ["a-b-anna", "a-b-ben"], "a-b"),  # the last one does
    ],
)
def test_dancers_have_names_of_any_alphabet(tmp_path, group, names, take):
    """José left the group, and no word of it."""
    touched(tmp_path, *(f"{name}.bvh" for name in names))
    (plan,) = takes_in(tmp_path, group=group)
    assert len(plan.files) == 2 and plan.name.startswith(take)


def test_files_that_are_in_no_group_are_named(tmp_path):
    touched(tmp_path, "duo_1.bvh", "duo_2.bvh", *(f"sub/solo{k}.bvh" for k in range(7)))
    with pytest.warns(UserWarning, match=r"does not fit sub/solo0\.bvh, .*solo4\.bvh and 2 more;"):
        assert len(takes_in(tmp_path, group="{take}_{dancer}")) == 8


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("take = 1", "[[take]]"),
        ("[[take]]", "files=None"),
        ('[[take]]\nfiles = ["no.bvh"]', "no.bvh' is not there"),
        ('[[take]]\nfiles = ["a.fbx"]', "'a.fbx' is no .bvh"),
        ('[[take]]\nfiles = ["/a.npz"]', "'/a.npz' must be relative"),
        ('[[take]]\nfiles = ["a.npz"]\nspeed = 1', "'speed' is unknown"),
        ('[[take]]\nfiles = ["a.npz"]\nup = "w"', "up='w'"),
        ('[[take]]\nfiles = ["a.npz"]\nfps = -1', "fps=-1"),
        ('[[take]]\nfiles = ["a.npz"]\nrest = "T"', "rest='T'"),
        ('[[take]]\nfiles = ["a.npz"]\nsplit = "half"', "split='half'"),
        ('[[take]]\nfiles = ["a.npz"]\ngenre = 3', "genre=3"),
        ('[[take]]\nfiles = ["a.npz"]\nkind = "fake"', "kind='fake' is not one of real"),
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
        ({"trans": np.zeros((9, 3))}, "it lacks poses; it has trans"),
        ({"joints": np.zeros((9, 24, 3))}, "it has joints .of joint positions make a .npy"),
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


def touched(folder, *names):
    for name in names:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).touch()


def test_takes_of_two_names_that_look_alike_stay_two(tmp_path):
    touched(tmp_path, "salsa/01.bvh", "salsa_01.bvh", "plain.bvh", "ワルツ.bvh", "サルサ.bvh")
    plans = takes_in(tmp_path)
    names = [plan.name for plan in plans]
    assert len(set(names)) == 5 and all(len(plan.files) == 1 for plan in plans)
    assert "plain" in names and sum(name.startswith("salsa_01_") for name in names) == 2
    assert [plan.name for plan in takes_in(tmp_path)] == names


def test_a_name_of_the_table_stays(tmp_path):
    touched(tmp_path, "a.bvh", "mine.bvh")
    (tmp_path / "takes.toml").write_text('[[take]]\nname = "mine"\nfiles = ["a.bvh"]\n')
    plans = {plan.labels[0]: plan.name for plan in takes_in(tmp_path)}
    assert plans["a.bvh"] == "mine" and plans["mine.bvh"].startswith("mine_")


def test_names_of_the_table_in_any_script_stay_apart(tmp_path):
    """All of one that is not Latin were called "take", and refused for that."""
    names = ["サルサ", "ワルツ", "duo no 1", "duo_no_1", "first waltz"]
    touched(tmp_path, *(f"{k}.bvh" for k in range(5)), "サルサ.wav")
    rows = [f'[[take]]\nname = "{name}"\nfiles = ["{k}.bvh"]\n' for k, name in enumerate(names)]
    (tmp_path / "takes.toml").write_text("".join(rows), encoding="utf-8")
    plans = {plan.labels[0]: plan for plan in takes_in(tmp_path)}
    salsa, waltz, spaced, plain, alone = (plans[f"{k}.bvh"].name for k in range(5))
    assert salsa.startswith("take_") and waltz.startswith("take_") and salsa != waltz
    assert (plain, alone) == ("duo_no_1", "first_waltz") and spaced.startswith("duo_no_1_")
    assert plans["0.bvh"].song == tmp_path / "サルサ.wav"


def test_takes_of_an_interrupted_run_are_no_motion(tmp_path):
    touched(tmp_path, "a.bvh", "out/takes/a.npz", "ready/takes/b.npz", "theirs/c.npz")
    (tmp_path / "ready" / "index.json").write_text('{\n"format": "dancediff-prepared-1",\n')
    (tmp_path / "theirs" / "index.json").write_text('{"videos": []}')
    plans = takes_in(tmp_path, leave_out=tmp_path / "out")
    assert [plan.labels[0] for plan in plans] == ["a.bvh", "theirs/c.npz"]
    (tmp_path / "ready" / "index.json").unlink()
    assert len(takes_in(tmp_path / "ready", leave_out=tmp_path / "ready")) == 1
    assert len(takes_in(tmp_path / "ready", leave_out=tmp_path)) == 1


def test_a_folder_within_the_source_is_prepared_twice_alike(duo, tmp_path, capsys):
    duo.dancer(0).save(tmp_path / "a.bvh")
    assert main(["prepare", "folder", str(tmp_path), str(tmp_path / "out")]) == 0
    (tmp_path / "out" / "index.json").unlink()
    assert main(["prepare", "folder", str(tmp_path), str(tmp_path / "out")]) == 0
    assert "made 0, kept 1" in capsys.readouterr().out


def test_takes_that_a_folder_no_longer_makes_leave_it(duo, tmp_path, capsys):
    """Dancers stayed as solos beside their group, some in val and the group in train."""
    src, other, out = tmp_path / "src", tmp_path / "other", tmp_path / "out"
    for folder in (src, other):
        folder.mkdir()
        for k in range(2):
            duo.dancer(k).save(folder / f"duo_{k}.npz")
    (other / "takes.toml").write_text(
        '[[take]]\nname = "theirs"\nfiles = ["duo_0.npz", "duo_1.npz"]\n'
    )
    for folder in (src, other):  # of the other one, files have the same names
        assert main(["prepare", "folder", str(folder), str(out)]) == 0
    names = {entry.name for entry in PreparedData(out)}
    assert names == {"duo_0", "duo_1", "theirs"}
    assert "dropped" not in capsys.readouterr().out
    group = ["--group", "{take}_{dancer}"]
    assert main(["prepare", "folder", str(src), str(out), *group]) == 0
    told = "dropped 2 takes, which their source no longer makes: duo_0, duo_1"
    assert told in capsys.readouterr().out
    assert told in (out / "report.md").read_text(encoding="utf-8")
    assert {entry.name for entry in PreparedData(out)} == {"duo", "theirs"}
    for folder in ("takes", "pictures"):
        assert {path.stem for path in (out / folder).iterdir()} == {"duo", "theirs"}
    assert main(["prepare", "folder", str(src), str(out), *group, "--json"]) == 0
    assert "dropped" not in json.loads(capsys.readouterr().out)


def test_songs_are_one_by_their_sound_not_their_name(duo, tmp_path):
    src, out = tmp_path / "src", tmp_path / "out"
    for folder, pitch in (("a", 9), ("b", 7), ("c", 7)):
        (src / folder).mkdir(parents=True)
        duo.save(src / folder / "A + B.npz")
        y = np.sin(np.arange(5 * 15360) / pitch).astype(np.float32)
        Music(y, 15360).save(src / folder / "A + B.WAV")
    assert main(["prepare", "folder", str(src), str(out)]) == 0
    a, b, c = PreparedData(out)
    assert len(a.groups) == 1 and a.group != b.group == c.group
    assert a.notes["song"] == "A + B.WAV"


def test_takes_to_one_song_follow_the_split_of_the_table(tmp_path):
    """The split of the others was drawn; then the whole folder was refused, after all the work."""
    for name, song in (("a", b"x"), ("b", b"x"), ("c", b"y"), ("d", None)):
        (tmp_path / f"{name}.bvh").touch()
        if song is not None:
            (tmp_path / f"{name}.wav").write_bytes(song)
    table = '[[take]]\nfiles = ["a.bvh"]\nsplit = "test"\n'
    (tmp_path / "takes.toml").write_text(table)
    splits = {plan.name: plan.split for plan in one_split_a_song(takes_in(tmp_path))}
    assert splits == {"a": "test", "b": "test", "c": None, "d": None}
    (tmp_path / "takes.toml").write_text(table + table.replace("a.", "b.").replace("test", "val"))
    with pytest.raises(ValueError, match="'a' in test and 'b' in val, but both are danced to one"):
        one_split_a_song(takes_in(tmp_path))


def test_tables_with_a_mark_and_settings_with_an_emoji_are_read(tmp_path):
    touched(tmp_path, "a.bvh")
    (tmp_path / "takes.toml").write_text('[[take]]\nfiles = ["a.bvh"]\n', encoding="utf-8-sig")
    assert [plan.name for plan in takes_in(tmp_path)] == ["a"]
    row = {"file": "\U0001f57a.bvh", "map": "cmu", "joints": {"root": "Hips"}, "up": "y"}
    path = write_settings(tmp_path, [row], [])
    path.write_text(path.read_text("utf-8").replace("false", "true"), encoding="utf-8-sig")
    assert read_checked(tmp_path)[0]["files"] == [row["file"]]


@pytest.mark.parametrize("unit", [1.0, 0.01])
def test_the_unit_of_joint_positions_counts_once(duo, tmp_path, unit):
    np.save(tmp_path / "a.npy", (duo.joints() / unit).numpy())
    motion = standing(tmp_path / "a.npy", Given(unit=unit, up="y")).motion
    assert torch.allclose(motion.root[..., [0, 2]], duo.root[..., [0, 2]], atol=1e-3)


def test_what_is_given_and_not_used_is_told(duo, tmp_path):
    duo.save(tmp_path / "a.npz")
    assert (
        "given fps, unit not used"
        in read_file(tmp_path / "a.npz", Given(fps=60, unit=2))[0].doubts[0]
    )
    assert read_file(tmp_path / "a.npz", Given())[0].doubts == []


def sparse(book, folder, dense: int):
    """The root goes in two keys, 0 and 2 s; other tracks have so many of their keys, or two."""
    animation, accessors = book["animations"][0], book["accessors"]
    blob = (folder / "a.bin").read_bytes()
    times = np.array([0, 2], dtype="<f4").tobytes()
    (folder / "a.bin").write_bytes(blob + times)
    book["buffers"][0]["byteLength"] = len(blob + times)
    book["bufferViews"].append({"buffer": 0, "byteOffset": len(blob), "byteLength": len(times)})
    view = len(book["bufferViews"]) - 1
    two = {"bufferView": view, "componentType": 5126, "count": 2, "type": "SCALAR"}
    accessors.append(two)
    for channel in animation["channels"]:
        sampler = animation["samplers"][channel["sampler"]]
        few = channel["target"]["path"] == "translation" or not dense
        accessors[sampler["output"]]["count"] = 2 if few else dense
        if few:
            sampler["input"] = len(accessors) - 1
        else:
            accessors[sampler["input"]]["count"] = dense


@pytest.mark.parametrize("dense", [31, 0])
def test_gltf_lasts_as_long_as_its_longest_track(tmp_path, dense):
    _, path = gltf(tmp_path, lambda book: sparse(book, tmp_path, dense))
    (bvh,) = read_gltf(path)
    assert (bvh.num_frames, bvh.fps) == (61, pytest.approx(30, rel=1e-4))


def test_dances_that_do_not_stand_are_told(duo, tmp_path):
    """Points in another convention, saved as a `Motion`, lay down or flew, and no word of it."""
    points = duo.dancer(0).joints()[:, ::4]
    mirror, lift = torch.tensor([-1.0, 1, 1]), torch.tensor([0.0, 0.9, 0])
    for changed, words in (
        (points[..., [0, 2, 1]] * mirror, "its bodies stand along z, not y"),
        (points + lift, "its floor is at 0.9"),
        (points * mirror, "toes point backward"),
    ):
        Motion.from_joints(changed).save(tmp_path / "a.npz")
        assert [one[: len(words)] for one in read_file(tmp_path / "a.npz", Given())[0].doubts] == [
            words
        ]
    duo.save(tmp_path / "a.npz")
    assert read_file(tmp_path / "a.npz", Given())[0].doubts == []
    np.save(tmp_path / "left.npy", (points * mirror).numpy())
    assert "toes point backward" in standing(tmp_path / "left.npy").doubts[0]


def test_a_take_in_which_nobody_moves_is_told(duo, tmp_path, monkeypatch):
    """A T-pose of its own passed for a dance."""
    monkeypatch.setattr(make, "with_soundtrack", lambda take: take)
    Motion(duo.pose[:, :1].repeat(1, 60, 1, 1, 1), duo.root[:, :1].repeat(1, 60, 1)).save(
        tmp_path / "a.npz"
    )
    plan = TakePlan("a", (tmp_path / "a.npz",), labels=("a.npz",))
    take = make.make_folder_take(plan, (Given(),), pictures=None)
    assert take.notes["doubts"] == ["nobody moves in it"]


def test_a_file_that_cuts_its_group_is_told(duo, tmp_path, monkeypatch):
    """A long dance became one of a second, and no word of it."""
    monkeypatch.setattr(make, "with_soundtrack", lambda take: take)
    plan = TakePlan("duo", (tmp_path / "a.npz", tmp_path / "b.npz"), labels=("a.npz", "b.npz"))
    whole = duo.num_frames
    for frames, doubts in (
        (whole - 5, []),
        (40, [f"cut to the 40 frames of b.npz, its shortest file; its longest has {whole}"]),
    ):
        duo.dancer(0).save(tmp_path / "a.npz")
        duo.dancer(1).frames(0, frames).save(tmp_path / "b.npz")
        take = make.make_folder_take(plan, (Given(), Given()), pictures=None)
        assert take.num_frames == frames and take.notes["doubts"] == doubts


def test_a_path_in_centimetres_is_told(duo, tmp_path):
    """Where it was short it passed for metres."""
    solo = replace(duo.dancer(0), root=100 * duo.dancer(0).root)
    amass(solo, tmp_path / "a.npz", mocap_framerate=30.0)
    assert "its unit may not be metres" in standing(tmp_path / "a.npz").doubts[0]
    assert standing(tmp_path / "a.npz", Given(unit=0.01)).doubts == []
