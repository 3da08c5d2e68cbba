r"""SMPL arrays of any common layout: AMASS's .npz, and pickles of AIST++'s or AIOZ-GDance's kind.

Read first: `dancediff.data.formats` · `dancediff.data.safe_pickle`.

    poses, or smpl_poses             axis-angle, 22 joints or more     (f, 66+) or (n, f, 66+)
    root_orient and pose_body        the same in two parts             (f, 3), (f, 63)
    trans, smpl_trans or root_trans  metres                            (f, 3) or (n, f, 3)
    smpl_scaling                     trans is divided by it            one number, may be missing
    mocap_framerate, mocap_frame_rate or fps                           one number, may be missing

A pickle of TCDiff has the rows of a group in one list, (f n, 72), and beside them the positions
full_pose (n, f, 24, 3), which tell how many dance and whose row is whose.

Body shapes are not used: everybody dances on the SMPL-24 skeleton.
"""

from pathlib import Path

import numpy as np
import torch

from dancediff.arrays import COMPRESSED, array_names, read_arrays
from dancediff.data.formats import plain_array
from dancediff.data.safe_pickle import load_pickle
from dancediff.motion.motion import Motion
from dancediff.motion.representation import whole_pose
from dancediff.motion.rotation import axis_angle_to_matrix

APART = 0.3  # metres from a path to the pelvis of the same dancer, whatever is its path
BODY = 22  # joints that SMPL, SMPL-H and SMPL-X share
_POSES = ("poses", "smpl_poses")
_TRANS = ("trans", "smpl_trans", "root_trans", "transl")
AISTPP_FPS = 60.0  # of its cameras; its files do not tell
RATES = ("mocap_framerate", "mocap_frame_rate", "fps", "framerate")
_PARTS = ("root_orient", "global_orient", "pose_body", "body_pose")
_SCALE = "smpl_scaling"


def read_smpl(path) -> tuple[Motion, bool]:
    """A dance as the file has it, its up axis not yet turned, and whether it tells its frame rate.

    Without a rate 30 is taken, and 60 of files with a scale but no rate, which are AIST++'s.

    Raises: OSError for no such file; ValueError naming the array that is missing or has another
    shape.
    """
    path = Path(path)
    if path.suffix.lower() == ".npz":
        keys = (*_POSES, *_TRANS, *RATES, *_PARTS, _SCALE)
        data = read_arrays(path, keys, expand=COMPRESSED)
        if not set(data) & {*_POSES, *_PARTS}:
            has = ", ".join(array_names(path)[:12]) or "nothing"
            raise ValueError(f"it lacks poses; it has {has} (of joint positions make a .npy)")
    else:
        data = load_pickle(path)
    if not isinstance(data, dict):
        raise ValueError(f"it holds a {type(data).__name__}, not a dict with poses and trans")
    data = _parted(data)
    poses, trans = _poses(data), _one_of(data, _TRANS, "trans")
    trans = _stacked(trans, "trans", 3) / _number(data, (_SCALE,), 1.0)
    if len(poses) != len(trans):
        raise ValueError(f"there are poses of {len(poses)} dancers and paths of {len(trans)}")
    f = min(poses.shape[1], trans.shape[1])
    joints = 24 if poses.shape[2] == 72 else BODY  # SMPL-H and SMPL-X go on with other joints
    v = torch.from_numpy(poses[:, :f, : 3 * joints]).float().unflatten(-1, (joints, 3))
    rate = _number(data, RATES, AISTPP_FPS if _SCALE in data else 0.0)
    pose = whole_pose(axis_angle_to_matrix(v))
    return Motion(pose, torch.from_numpy(trans[:, :f]), rate or 30.0), rate > 0


def _parted(data: dict) -> dict:
    """The rows of a group dancer by dancer, where ``full_pose`` shows that there is one."""
    full = data.get("full_pose")
    if (
        not isinstance(full, np.ndarray)
        or full.ndim != 4
        or full.dtype.kind not in "fiu"
        or full.size == 0
    ):
        return data
    n, f = full.shape[:2]
    rows, path = data.get("smpl_poses"), data.get("smpl_trans")
    if not (isinstance(rows, np.ndarray) and isinstance(path, np.ndarray)):
        return data
    if rows.ndim != 2 or len(rows) != n * f or not _is_path(path, n * f):
        return data
    by_frame = rows.reshape(f, n, -1).swapaxes(0, 1), path.reshape(f, n, 3).swapaxes(0, 1)
    by_dancer = rows.reshape(n, f, -1), path.reshape(n, f, 3)
    nearest = min(by_frame, by_dancer, key=lambda parts: np.abs(parts[1] - full[:, :, 0]).max())
    if not np.abs(nearest[1] - full[:, :, 0]).max() < APART:
        raise ValueError("smpl_trans are not the first joints of full_pose, so dancers are mixed")
    return data | dict(zip(("smpl_poses", "smpl_trans"), nearest, strict=True))


def _is_path(path: np.ndarray, rows: int) -> bool:
    return path.size == 3 * rows and path.dtype.kind in "fiu"


def _poses(data: dict) -> np.ndarray:
    if not any(name in data for name in _POSES) and any(name in data for name in _PARTS):
        turn = _stacked(_one_of(data, _PARTS[:2], _PARTS[0]), _PARTS[0], 3)
        body = _stacked(_one_of(data, _PARTS[2:], _PARTS[2]), _PARTS[2], None)
        if turn.shape[:2] != body.shape[:2]:
            raise ValueError(f"root_orient {turn.shape} and pose_body {body.shape} do not fit")
        poses = np.concatenate([turn, body], axis=-1)
    else:
        poses = _stacked(_one_of(data, _POSES, "poses"), "poses", None)
    if poses.shape[2] < 3 * BODY or poses.shape[2] % 3:
        raise ValueError(
            f"poses have {poses.shape[2]} numbers a frame; expected 66, 72, 156 or 165"
        )
    return poses


def _one_of(data: dict, names: tuple[str, ...], label: str):
    found = next((data[name] for name in names if name in data), None)
    if found is None:
        raise ValueError(
            f"it lacks {label}; it has {', '.join(map(str, list(data)[:12])) or 'none'}"
        )
    return found


def _stacked(value, name: str, width: int | None) -> np.ndarray:
    """An array (n, f, width) of finite numbers; one dancer may come without n."""
    dims = getattr(value, "ndim", 2)
    shape = (None, None, width) if dims == 3 else (None, width)
    array = plain_array(value, name, shape)
    return array if dims == 3 else array[None]


def _number(data: dict, names: tuple[str, ...], default: float) -> float:
    """The first of these fields, which must be one positive number."""
    for name in names:
        if name in data:
            value = np.asarray(data[name])
            if value.dtype.kind not in "fiu" or value.size != 1 or not 1e-3 < value.item() < 1e6:
                raise ValueError(f"{name} is no single positive number")
            return float(value.item())
    return default
