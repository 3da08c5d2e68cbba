import json
from dataclasses import replace

import numpy as np
import pytest
import torch

from dancediff.arrays import read_arrays
from dancediff.data.resample import resample_motion
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix


def random_motion(n=2, f=12, contact=True):
    generator = torch.Generator().manual_seed(0)
    return Motion(
        axis_angle_to_matrix(0.4 * torch.randn(n, f, 24, 3, generator=generator)),
        torch.randn(n, f, 3, generator=generator),
        contact=torch.rand(n, f, 4, generator=generator) if contact else None,
        meta={"seed": 3},
    )


def test_features_round_trip():
    motion = random_motion()
    again = Motion.from_features(motion.features())
    assert torch.allclose(again.joints(), motion.joints(), atol=1e-5)
    assert torch.equal(again.contact, motion.contact)


def test_lodge_features_keep_every_joint_in_its_place():
    motion = random_motion()
    x = motion.features("lodge")
    again = Motion.from_features(x, name="lodge")
    assert x.shape == (2, 12, 139) and again.pose.shape == motion.pose.shape
    assert torch.allclose(again.joints(), motion.joints(), atol=1e-5)
    assert torch.equal(again.contact, motion.contact)
    assert torch.equal(again.pose[:, :, 22:], torch.eye(3).expand(2, 12, 2, 3, 3))
    with pytest.raises(ValueError, match="139 features"):
        Motion.from_features(x)
    with pytest.raises(ValueError, match="'tcdiffpp', 'lodge'"):
        motion.features("edge")


@pytest.mark.parametrize("contact", [True, False])
def test_file_round_trip(tmp_path, contact):
    motion = random_motion(contact=contact)
    motion.save(tmp_path / "dance.npz")
    again = Motion.load(tmp_path / "dance.npz")
    assert torch.allclose(again.joints(), motion.joints(), atol=1e-5)
    assert again.meta == {"seed": 3} and again.fps == 30
    assert (again.contact is not None) == contact
    assert [p.name for p in tmp_path.iterdir()] == ["dance.npz"]  # no temporary file stays


def test_slicing():
    motion = random_motion(f=60)
    assert motion.seconds(0.5, 1.0).num_frames == 15
    assert torch.equal(motion.frames(10, 20).root, motion.root[:, 10:20])
    assert motion.dancer(1).num_dancers == 1
    with pytest.raises(ValueError, match="empty"):
        motion.frames(60, 70)


def test_shapes_that_do_not_fit_are_named():
    with pytest.raises(ValueError, match="root has shape"):
        Motion(torch.eye(3).expand(4, 24, 3, 3), torch.zeros(4, 3))
    with pytest.raises(ValueError, match="pose has shape"):
        Motion(torch.eye(3).expand(1, 4, 23, 3, 3), torch.zeros(1, 4, 3))
    with pytest.raises(ValueError, match="contact has shape"):
        Motion(torch.eye(3).expand(1, 4, 24, 3, 3), torch.zeros(1, 4, 3), contact=torch.zeros(4))


def test_bad_files(tmp_path):
    with pytest.raises(FileNotFoundError):
        Motion.load(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(ValueError, match=r"text\.npz"):
        Motion.load(tmp_path / "text.npz")
    np.savez(tmp_path / "other.npz", a=np.zeros(3))
    with pytest.raises(ValueError, match=r"other\.npz"):
        Motion.load(tmp_path / "other.npz")
    np.savez(tmp_path / "pickle.npz", header=np.array([{"evil": 1}], dtype=object))
    with pytest.raises(ValueError, match=r"pickle\.npz"):
        Motion.load(tmp_path / "pickle.npz")
    with pytest.raises(ValueError, match=r"suffix '\.xyz'"):
        random_motion().save(tmp_path / "dance.xyz")


@pytest.mark.parametrize(
    ("part", "value", "reason"),
    [
        ("rot6d", np.ones((2, 12, 24, 12), dtype=np.float32), "rot6d has shape"),
        ("rot6d", np.array([{}]), "fill|object"),
        ("offsets", np.ones((23, 3), dtype=np.float32), "no tree"),
        ("fps", np.ones(2), "size-1|scalar|length-1|one"),
        ("header", np.array("[" * 100_000), "recursion"),
        ("header", np.array("{}"), "format"),
    ],
)
def test_a_file_with_a_wrong_part_is_refused(tmp_path, part, value, reason):
    path = random_motion().save(tmp_path / "dance.npz")
    np.savez(path, **{**read_arrays(path), part: value})
    with pytest.raises(ValueError, match=rf"dance\.npz.*({reason})"):
        Motion.load(path)


@pytest.mark.parametrize("parents", [[-1, 0, 3, 2], [0] * 24, [-1, "a"], [-1, 30]])
def test_joints_that_are_no_tree_are_refused(tmp_path, parents):
    path = random_motion().save(tmp_path / "dance.npz")
    arrays = read_arrays(path)
    header = {**json.loads(str(arrays["header"])), "parents": parents}
    np.savez(path, **{**arrays, "header": np.array(json.dumps(header))})
    with pytest.raises(ValueError, match="no tree"):
        Motion.load(path)


def test_a_dance_says_in_one_line_what_it_is():
    assert repr(random_motion()) == "Motion(0.4 s, 2 dancers, 12 frames, seed 3)"
    shown = random_motion()._repr_mimebundle_()
    assert shown["text/plain"] == repr(random_motion())
    assert shown["text/html"].startswith('<img src="data:image/png;base64,iVBOR')
    assert len(shown["text/html"]) < 200_000


@pytest.mark.parametrize("fps", [0.0, -30.0, 1e9, float("nan"), float("inf")])
def test_frame_rates_that_nothing_records_are_refused(fps):
    with pytest.raises(ValueError, match=r"must lie in 1 \.\.\. 1000"):
        Motion(torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3), fps=fps)


@pytest.mark.parametrize("k", [-1, 2])
def test_a_dancer_who_is_not_there_is_named(k):
    with pytest.raises(ValueError, match=rf"dancer\({k}\) must lie in 0 \.\.\. 1"):
        random_motion(n=2).dancer(k)


def test_a_part_knows_its_own_seams_and_no_order_of_the_whole():
    motion = random_motion(f=90)
    motion.meta |= {"seams": [20, 60], "swap": [1, 0]}
    part = motion.frames(10, 50)
    assert part.meta["seams"] == [10] and "swap" not in part.meta
    assert motion.frames(0, 90).meta["swap"] == [1, 0] and "swap" not in motion.dancer(0).meta
    part.meta["seed"] = 4
    assert motion.meta == {"seed": 3, "seams": [20, 60], "swap": [1, 0]}
    assert resample_motion(motion, 60).meta["seams"] == [40, 120]


def test_a_part_begins_with_the_dance_at_the_earliest():
    motion = random_motion(f=60)
    assert torch.equal(motion.seconds(-1, 1).root, motion.frames(0, 30).root)
    assert torch.equal(motion.seconds(0.5, float("inf")).root, motion.root[:, 15:])


def test_features_may_be_an_array():
    motion = random_motion()
    again = Motion.from_features(motion.features().numpy())
    assert torch.allclose(again.joints(), motion.joints(), atol=1e-5)
    with pytest.raises(ValueError, match=r"x is a str; give a tensor or array \(n, f, 151\)"):
        Motion.from_features("dance.npz")
    with pytest.raises(ValueError, match=r"x has shape \(12, 151\); expected \(n, f, 151\)"):
        Motion.from_features(motion.features()[0])


def test_no_dances_are_not_put_side_by_side():
    with pytest.raises(ValueError, match="motions is empty; give one dance or more"):
        Motion.side_by_side([])


@pytest.mark.parametrize("made", [{"synthetic": True}, {"model": "lodge"}])
def test_a_group_in_which_somebody_was_not_real_is_synthetic(made):
    danced, own = random_motion(), replace(random_motion(), meta=made)
    for dances in ([danced, own], [own, danced]):
        assert Motion.side_by_side(dances).is_synthetic
    assert not Motion.side_by_side([danced, danced]).is_synthetic
    assert Motion.side_by_side([own, own]).meta == made and not danced.is_synthetic


def test_facts_of_numpy_and_torch_are_saved(tmp_path):
    facts = {"a": np.float32(3), "b": np.arange(2), "c": [torch.tensor(1.5)], "d": {"e": np.True_}}
    motion = replace(random_motion(), meta=facts)
    again = Motion.load(motion.save(tmp_path / "m.npz"))
    assert again.meta == {"a": 3.0, "b": [0, 1], "c": [1.5], "d": {"e": True}}


@pytest.mark.parametrize(
    ("facts", "message"),
    [
        ({"a": {"b": {1, 2}}}, r"meta\['a'\]\['b'\] is a set.*make it a number, a str, a list"),
        ({"when": np.datetime64("2020-01-01")}, r"meta\['when'\] is a date"),
        ({(1, 2): "a"}, r"meta has the key \(1, 2\), a tuple; make it a str"),
    ],
)
def test_facts_that_no_file_holds_are_named(tmp_path, facts, message):
    with pytest.raises(ValueError, match=message):
        replace(random_motion(), meta=facts).save(tmp_path / "m.npz")
    assert list(tmp_path.iterdir()) == []
