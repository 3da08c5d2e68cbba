r"""A dance at another frame rate.

Symbols (axes: n dancers · f frames · j joints)
    pose   rotations relative to the parent   (n, f, j, 3, 3)
    root   pelvis position, metres            (n, f, 3)
"""

import math
from dataclasses import replace

import torch
from torch import Tensor

from dancediff.axes import FPS
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import slerp


def resample_motion(motion: Motion, fps: float = FPS) -> Motion:
    r"""Bring a dance to another frame rate: rotations by slerp, paths along straight lines.

    $$R(\tau) = R_k \exp\!\big(w \log(R_k^\top R_{k+1})\big),\quad
      p(\tau) = (1 - w)\, p_k + w\, p_{k+1},\quad \tau = k + w$$

    Frames that exist are kept bit for bit: 60 to 30 frames a second takes every other frame, as
    EDGE does. Contacts of the nearest earlier frame are kept. Nothing is filtered first.

    Shapes: (n, f, ...) -> (n, 1 + floor((f - 1) * fps / motion.fps), ...).
    Raises: ValueError when ``fps`` is not a positive number.

    >>> still = Motion(torch.eye(3).expand(1, 61, 24, 3, 3), torch.zeros(1, 61, 3), fps=60)
    >>> half = resample_motion(still, 30)
    >>> half.num_frames, half.fps
    (31, 30)
    """
    if not (math.isfinite(fps) and fps > 0):
        raise ValueError(f"fps={fps} is no frame rate; choose a positive number, such as 30")
    if fps == motion.fps:
        return motion
    before, after, w = moments(motion.num_frames, motion.fps, fps)
    w = w.float()
    pose, root = motion.pose[:, before], motion.root[:, before]
    if w.any():
        between = w[None, :, None].expand(pose.shape[:3])
        moved = slerp(pose, motion.pose[:, after], between)
        pose = torch.where((w == 0)[None, :, None, None, None], pose, moved)
        root = torch.lerp(root, motion.root[:, after], w[None, :, None])
    contact = None if motion.contact is None else motion.contact[:, before]
    meta = dict(motion.meta)
    if isinstance(meta.get("seams"), list):
        at = [round(seam * fps / motion.fps) for seam in meta["seams"]]
        meta["seams"] = [seam for seam in at if 0 < seam < len(before)]
    return replace(motion, pose=pose, root=root, contact=contact, fps=fps, meta=meta)


def moments(frames: int, old: float, new: float) -> tuple[Tensor, Tensor, Tensor]:
    """For each new frame the old frames before and behind it, and how far it is between, 0 to 1.

    >>> [row.tolist() for row in moments(4, 60, 40)]
    [[0, 1, 3], [1, 2, 3], [0.0, 0.5, 0.0]]
    """
    last = frames - 1
    at = torch.arange(int(last * new / old + 1e-6) + 1, dtype=torch.float64) * old / new
    before = (at + 1e-6).floor().long().clamp(max=last)
    w = (at - before).clamp(0, 1)
    return before, (before + 1).clamp(max=last), torch.where(w < 1e-6, 0, w)
