r"""SMPL arrays as AMASS keeps them (.npz), one dancer a file, and back.

Viewers of human motion (the SMPL add-ons of Blender, aitviewer and others) read these files. AMASS
has z up, so the whole body is turned by 90 degrees about x; ``trans`` moves a body whose pelvis
rests at J_0, so that is taken off the path of the pelvis.

Symbols (axes: f frames)
    poses  axis-angle vectors of SMPL-H's 52 joints, radians; hands are not bent    (f, 156)
    trans  metres, z up                                                             (f, 3)
    J_0    where the pelvis of the neutral SMPL body rests, metres
"""

import zipfile
from pathlib import Path

import numpy as np
import torch

from dancediff.arrays import COMPRESSED, read_arrays
from dancediff.atomic import atomic_write
from dancediff.data.folder.smpl import RATES
from dancediff.motion.motion import MOST_FPS, Motion
from dancediff.motion.representation import whole_pose
from dancediff.motion.rotation import axis_angle_to_matrix, matrix_to_axis_angle, rotation_about
from dancediff.motion.skeleton import SMPL24

BODY = 22  # joints that our skeleton shares with SMPL-H
JOINTS = 52  # joints that SMPL-H has
J_0 = (-0.0018, -0.2233, 0.0282)  # of another body shape a centimetre or two away


def save_smpl(motion: Motion, path) -> Path:
    r"""Write one dancer as ``poses``, ``trans``, ``betas``, ``gender``, ``mocap_framerate``.

    $$\theta_0 = \log(U R_0), \qquad \text{trans} = U\,p - J_0, \qquad
      U = \text{90 degrees about x}$$

    ``synthetic``, which AMASS has not, tells whether a model or the choreographer made it. How the
    two hands are turned is not kept; no joint's position depends on it. Of a body with other bones
    only the rotations and the path are kept. The file appears whole or not at all.

    Raises: ValueError for more than one dancer, or another skeleton than SMPL-24.
    """
    if motion.num_dancers != 1 or motion.skeleton.names != SMPL24.names:
        raise ValueError(
            f"motion has {motion.num_dancers} dancers with {motion.skeleton.num_joints} joints; a "
            "SMPL file holds one with those of SMPL-24: write motion.dancer(k) for each k"
        )
    up = rotation_about("x", torch.tensor(torch.pi / 2, dtype=torch.float64))
    R = motion.pose[0, :, :BODY].double()
    R = torch.cat([up @ R[:, :1], R[:, 1:]], dim=1)
    poses = torch.zeros(motion.num_frames, JOINTS, 3, dtype=torch.float64)
    poses[:, :BODY] = matrix_to_axis_angle(R)
    trans = motion.root[0].double() @ up.T - torch.tensor(J_0, dtype=torch.float64)
    arrays: dict[str, np.ndarray] = {
        "poses": poses.flatten(1).numpy(),
        "trans": trans.numpy(),
        "betas": np.zeros(16),
        "gender": np.array("neutral"),
        "mocap_framerate": np.array(float(motion.fps)),
        "synthetic": np.array(motion.is_synthetic),  # so that nobody takes it for real
    }
    path = Path(path)
    with atomic_write(path) as part, part.open("wb") as file:
        np.savez(file, **arrays)  # type: ignore[arg-type]
    return path


def load_smpl(path) -> Motion:
    """Read one dancer from a file in AMASS's layout, z up; 66 to 165 pose numbers.

    SMPL-X has ``mocap_frame_rate`` for the rate. Shapes follow our own skeleton: ``betas`` are not
    looked at.

    Raises: FileNotFoundError, or ValueError naming the file and what is wrong with it.
    """
    path = Path(path)
    try:
        keys = ("poses", "trans", "synthetic", *RATES)
        arrays = read_arrays(path, keys, expand=COMPRESSED)
        rate = next((key for key in RATES if key in arrays), RATES[0])
        missing = [key for key in ("poses", "trans", rate) if key not in arrays]
        if missing:
            raise ValueError(f"it lacks {', '.join(missing)}")
        poses, trans = (np.asarray(arrays[key], dtype=np.float64) for key in ("poses", "trans"))
        fps = float(arrays[rate])
        synthetic = bool(np.any(arrays.get("synthetic", False)))
        width = poses.shape[1] if poses.ndim == 2 else 0
        if width < 3 * BODY or width % 3 or trans.shape != (len(poses), 3):
            raise ValueError(f"poses {poses.shape} and trans {trans.shape} do not fit together")
        if not (np.isfinite(poses).all() and np.isfinite(trans).all() and np.isfinite(fps)):
            raise ValueError("it has numbers that are not finite")
        if not len(poses) or not 1 <= fps <= MOST_FPS:
            raise ValueError(f"it has {len(poses)} frames at fps={fps:g}")
    except (ValueError, TypeError, KeyError, zipfile.BadZipFile) as err:
        raise ValueError(f"{path} is no SMPL motion in AMASS's layout: {err}") from err
    down = rotation_about("x", torch.tensor(-torch.pi / 2, dtype=torch.float64))
    R = axis_angle_to_matrix(torch.from_numpy(poses[:, : 3 * BODY]).unflatten(-1, (BODY, 3)))
    R = torch.cat([down @ R[:, :1], R[:, 1:]], dim=1)
    root = (torch.from_numpy(trans) + torch.tensor(J_0, dtype=torch.float64)) @ down.T
    meta: dict = {"source": "smpl"} | ({"synthetic": True} if synthetic else {})
    return Motion(whole_pose(R[None]), root[None], fps, meta=meta)
