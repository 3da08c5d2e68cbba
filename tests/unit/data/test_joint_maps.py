import pytest

from dancediff.data.joint_maps import NEEDED, bones, find_joints
from dancediff.motion.skeleton import SMPL24

MIDDLE = ["Hips", "Spine", "Spine1", "Spine2", "Neck", "Head"]
MIXAMO = MIDDLE + [
    f"{side}{part}"
    for side in ("Left", "Right")
    for part in ("Shoulder", "Arm", "ForeArm", "Hand", "UpLeg", "Leg", "Foot", "ToeBase")
]
PLAIN = ["Hips", "Chest", "Neck", "Head"] + [
    f"{side}{part}"
    for side in ("Left", "Right")
    for part in ("Collar", "Shoulder", "Elbow", "Wrist", "Hip", "Knee", "Ankle")
]
BLENDER = ["pelvis", "spine_01", "spine_02", "spine_03", "neck_01", "head"] + [
    f"{part}_{side}"
    for side in "lr"
    for part in ("clavicle", "upperarm", "lowerarm", "hand", "thigh", "calf", "foot", "ball")
]


@pytest.mark.parametrize("which", ["mixamo", "generic"])
@pytest.mark.parametrize("prefix", ["", "mixamorig:"])
def test_mixamo(which, prefix):
    found = find_joints([prefix + name for name in MIXAMO], which)
    assert found["lcollar"] == prefix + "LeftShoulder"
    assert found["lshoulder"] == prefix + "LeftArm"
    assert found["rhip"] == prefix + "RightUpLeg"
    assert found["rknee"] == prefix + "RightLeg"
    assert found["chest"] == prefix + "Spine2"
    assert found["belly"] == prefix + "Spine"
    assert found["ltoe"] == prefix + "LeftToeBase"


def test_shoulder_means_the_shoulder_where_there_is_no_arm():
    found = find_joints(PLAIN)
    assert (found["lcollar"], found["lshoulder"]) == ("LeftCollar", "LeftShoulder")
    assert (found["rhip"], found["rknee"], found["rankle"]) == (
        "RightHip",
        "RightKnee",
        "RightAnkle",
    )


def test_sides_may_stand_behind():
    found = find_joints(BLENDER)
    assert (found["lshoulder"], found["lelbow"], found["rhip"]) == (
        "upperarm_l", "lowerarm_l", "thigh_r",
    )  # fmt: skip


def test_no_joint_plays_two_parts():
    for names in (MIXAMO, PLAIN, BLENDER, SMPL24.names):
        found = list(find_joints(names).values())
        assert len(set(found)) == len(found)


def test_our_own_names_are_themselves():
    found = find_joints(SMPL24.names)
    assert found == {name: name for name in SMPL24.names}


def test_a_map_of_ones_own():
    own = {name: f"X{name}" for name in SMPL24.names}
    names = [f"X{name}" for name in NEEDED]
    assert find_joints(names, own) == {name: own[name] for name in NEEDED}
    with pytest.raises(ValueError, match="'elbow'"):
        find_joints(names, {"elbow": "Xlelbow"})


def test_missing_joints_are_named():
    with pytest.raises(ValueError, match="finds no relbow among"):
        find_joints([name for name in SMPL24.names if name != "relbow"])
    with pytest.raises(ValueError, match="joints='vicon' is no map"):
        find_joints(SMPL24.names, "vicon")


def test_bones_pass_over_what_is_not_mapped():
    pairs = bones(["belly", "neck", "lhip", "lknee", "lshoulder", "rshoulder"])
    assert set(pairs) == {("belly", "neck"), ("lhip", "lknee"), ("rshoulder", "lshoulder")}
