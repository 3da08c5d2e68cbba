"""`dancediff convert`: from any format that can be read to any that can be written."""

import json
from dataclasses import replace

import pytest
import torch

from dancediff.cli import main
from dancediff.data.choreographer import choreograph
from dancediff.motion.motion import Motion


@pytest.fixture(scope="module")
def duet(tmp_path_factory):
    dance, _ = choreograph([0.5, 1.0], dancers=2, seed=0, seconds=1.5)
    return dance.save(tmp_path_factory.mktemp("duet") / "duet.npz")


def joints_apart(a: Motion, b: Motion) -> float:
    return (a.joints() - b.joints()).norm(dim=-1).max().item()


@pytest.mark.parametrize("suffix", [".npz", ".glb", ".bvh", ".smpl.npz"])
def test_there_and_back(duet, suffix, tmp_path, capsys):
    there = tmp_path / "new" / f"dance{suffix}"
    assert main(["convert", str(duet), str(there), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["dancers"], facts["frames"]) == (2, 45)
    files = sorted(map(str, there.parent.iterdir()))
    assert len(files) == (1 if suffix in (".npz", ".glb") else 2)
    assert facts["written"] == files[0]
    assert main(["convert", *files, str(tmp_path / "back.npz")]) == 0
    assert joints_apart(Motion.load(duet), Motion.load(tmp_path / "back.npz")) < 1e-3


@pytest.mark.parametrize("suffix", [".glb", ".smpl.npz"])
@pytest.mark.parametrize(
    ("meta", "synthetic"), [({"model": "tcdiffpp"}, True), ({"synthetic": True}, True), ({}, False)]
)
def test_what_no_person_danced_stays_known_there_and_back(duet, suffix, meta, synthetic, tmp_path):
    """`prepare folder` took a generated dance for a real one once it had been a .glb."""
    replace(Motion.load(duet).dancer(0), meta=meta).save(tmp_path / "solo.npz")
    there, back = str(tmp_path / f"there{suffix}"), str(tmp_path / "back.npz")
    assert main(["convert", str(tmp_path / "solo.npz"), there]) == 0
    assert main(["convert", there, back]) == 0
    assert Motion.load(there).is_synthetic is Motion.load(back).is_synthetic is synthetic


def test_a_picture_and_a_page(duet, tmp_path):
    for name in ("dance.png", "dance.html"):
        assert main(["convert", str(duet), str(tmp_path / name)]) == 0
        assert (tmp_path / name).stat().st_size > 1000


@pytest.mark.parametrize(
    ("files", "message"),
    [
        (["DUET"], "1 files are given; name a dance, then the file to write"),
        (["DUET", "dance.fbx"], "'dance.fbx', the file to write, should end in one of .npz"),
        (["missing.npz", "dance.glb"], "'missing.npz' does not exist; name a dance"),
        (["DUET", "dance.bvh", "--body", "mesh"], "body='mesh' goes with .glb only"),
        (["DUET", "dance.html", "--song", "missing.ogg"], "missing.ogg"),
    ],
)
def test_wrong_files_are_named(duet, files, message, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["convert", *(name.replace("DUET", str(duet)) for name in files)]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_forgotten_target_costs_no_dance(duet, tmp_path, capsys):
    """Of two files of a group the second is not what should be written."""
    assert main(["convert", str(duet), str(tmp_path / "d.bvh")]) == 0
    files = sorted(tmp_path.iterdir())
    before = [file.read_bytes() for file in files]
    assert main(["convert", *map(str, files)]) == 2
    said = capsys.readouterr().err
    assert files[1].name in said and "name a new file last" in said
    assert [file.read_bytes() for file in sorted(tmp_path.iterdir())] == before


@pytest.mark.parametrize(
    ("sources", "target"),
    [
        (["s.1.bvh", "s.3.bvh"], "s.bvh"),  # s.1 would be overwritten, s.3 removed
        (["s.3.bvh", "s.2.bvh"], "sub/../s.bvh"),
        (["a.glb", "s.1.bvh"], "a.glb"),
    ],
)
def test_no_dance_that_is_read_is_replaced_or_removed(duet, sources, target, tmp_path, capsys):
    for name in ("s.1.bvh", "s.2.bvh", "s.3.bvh", "a.glb"):
        Motion.load(duet).dancer(0).save(tmp_path / name)
    (tmp_path / "sub").mkdir()
    before = {file: file.read_bytes() for file in tmp_path.glob("*.*")}
    assert main(["convert", *(str(tmp_path / name) for name in (*sources, target))]) == 2
    said = capsys.readouterr().err
    assert "would replace or remove" in said and "name another file last" in said
    assert {file: file.read_bytes() for file in tmp_path.glob("*.*")} == before


def test_a_damaged_dance_is_refused(duet, tmp_path, capsys):
    (tmp_path / "half.npz").write_bytes(duet.read_bytes()[:500])
    assert main(["convert", str(tmp_path / "half.npz"), str(tmp_path / "dance.glb")]) == 2
    assert "half.npz" in capsys.readouterr().err
    assert not (tmp_path / "dance.glb").exists()


def test_what_is_written_is_the_dance_and_not_a_view_of_it(duet, tmp_path):
    path = tmp_path / "copy.npz"
    assert main(["convert", str(duet), str(path)]) == 0
    assert torch.equal(Motion.load(path).root, Motion.load(duet).root)
