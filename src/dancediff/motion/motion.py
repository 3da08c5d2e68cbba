r"""`Motion`: a dance of one or more people.

Read first: notebook 01.

Symbols (axes: n dancers · f frames · j joints)
    pose     rotation of each joint relative to its parent   (n, f, j, 3, 3)
    root     pelvis position, metres, y up                   (n, f, 3)
    contact  foot on the floor, 0..1                         (n, f, 4)
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.motion.contact import foot_contact
from dancediff.motion.files import files
from dancediff.motion.from_joints import fit_rotations
from dancediff.motion.representation import pack, spec_named, unpack, whole_pose
from dancediff.motion.skeleton import SMPL24, Skeleton, forward_kinematics

TOLD = ("model", "song", "seed", "genre", "kind")  # of a dance's meta, in its one line
MOST_FPS = 1000.0  # no camera for motion capture is faster; metrics smooth over seconds of frames


@dataclass(eq=False, repr=False)
class Motion:
    """A dance: joint rotations and root paths of n dancers over f frames.

    All tensors are CPU float32 without gradient. A solo has n = 1.

    Raises: ValueError naming the array and its shape when the parts do not fit together.

    >>> still = Motion(torch.eye(3).expand(2, 30, 24, 3, 3), torch.zeros(2, 30, 3))
    >>> still
    Motion(1.0 s, 2 dancers, 30 frames)
    >>> still.joints().shape
    torch.Size([2, 30, 24, 3])
    """

    pose: Tensor
    root: Tensor
    fps: float = 30.0
    skeleton: Skeleton = field(default=SMPL24, repr=False)
    contact: Tensor | None = None
    meta: dict = field(default_factory=dict)

    def __post_init__(self):
        self.pose = _plain(self.pose)
        self.root = _plain(self.root)
        n, f = self.root.shape[:2] if self.root.ndim == 3 else (0, 0)
        j = self.skeleton.num_joints
        if self.root.shape != (n, f, 3) or n == 0 or f == 0:
            raise ValueError(f"root has shape {tuple(self.root.shape)}; expected (n, f, 3)")
        if self.pose.shape != (n, f, j, 3, 3):
            raise ValueError(
                f"pose has shape {tuple(self.pose.shape)}; expected {(n, f, j, 3, 3)} to match root"
            )
        if self.contact is not None:
            self.contact = _plain(self.contact)
            if self.contact.shape != (n, f, 4):
                raise ValueError(
                    f"contact has shape {tuple(self.contact.shape)}; expected {(n, f, 4)}"
                )
        if not 1 <= self.fps <= MOST_FPS:
            raise ValueError(f"fps={self.fps:g} must lie in 1 ... {MOST_FPS:g}")

    @property
    def is_synthetic(self) -> bool:
        """Whether its facts say that a model or the choreographer made it, and nobody danced it."""
        return "model" in self.meta or bool(self.meta.get("synthetic"))

    @property
    def num_dancers(self) -> int:
        """How many people dance."""
        return self.root.shape[0]

    def __repr__(self) -> str:
        """One line: length, dancers, and what the dance knows of its making."""
        facts = [f"{self.duration:.1f} s", self.people, f"{self.num_frames} frames"]
        facts += [f"{key} {self.meta[key]}" for key in TOLD if key in self.meta]
        return f"Motion({', '.join(facts)})"

    def _repr_mimebundle_(self, include=None, exclude=None) -> dict:
        """What a notebook shows: that line, and a small picture."""
        return {"text/plain": repr(self), "text/html": files().picture(self)}

    @property
    def people(self) -> str:
        """How many dance, in words: "1 dancer", "3 dancers"."""
        return "1 dancer" if self.num_dancers == 1 else f"{self.num_dancers} dancers"

    @property
    def num_frames(self) -> int:
        """Length in frames."""
        return self.root.shape[1]

    @property
    def duration(self) -> float:
        """Length in seconds."""
        return self.num_frames / self.fps

    def joints(self) -> Tensor:
        """Joint positions in metres, (n, f, j, 3), by forward kinematics."""
        return forward_kinematics(self.pose, self.root, self.skeleton)

    def contacts(self) -> Tensor:
        """Which feet are on the floor, (n, f, 4): ``contact``, or else found from the joints."""
        return self.contact if self.contact is not None else foot_contact(self.joints(), self.fps)

    def frames(self, start: int, stop: int) -> "Motion":
        """The frames start..stop-1, as with a slice of a list.

        Of ``meta``, seams are counted anew, and an order that was asked for at the end is left out.

        Raises: ValueError when no frame is left.
        """
        part = slice(start, stop)
        if self.root[:, part].shape[1] == 0:
            raise ValueError(f"frames({start}, {stop}) is empty; there are {self.num_frames}")
        contact = None if self.contact is None else self.contact[:, part]
        meta, (first, last, _) = dict(self.meta), part.indices(self.num_frames)
        if isinstance(meta.get("seams"), list):  # a file may hold anything
            meta["seams"] = [seam - first for seam in meta["seams"] if first < seam < last]
        if (first, last) != (0, self.num_frames):
            meta.pop("swap", None)
        pose, root = self.pose[:, part], self.root[:, part]
        return replace(self, pose=pose, root=root, contact=contact, meta=meta)

    def seconds(self, start: float, stop: float) -> "Motion":
        """The part between two times; what lies before or behind the dance is left out."""
        stop = min(max(stop, 0), self.duration)
        return self.frames(round(max(start, 0) * self.fps), round(stop * self.fps))

    def dancer(self, k: int) -> "Motion":
        """One dancer as a solo.

        Raises: ValueError when there is no such dancer.
        """
        if not 0 <= k < self.num_dancers:
            raise ValueError(f"dancer({k}) must lie in 0 ... {self.num_dancers - 1}")
        contact = None if self.contact is None else self.contact[k : k + 1]
        meta = {key: value for key, value in self.meta.items() if key != "swap"}  # of a group
        pose, root = self.pose[k : k + 1], self.root[k : k + 1]
        return replace(self, pose=pose, root=root, contact=contact, meta=meta)

    def features(self, name: str = "tcdiffpp") -> Tensor:
        """The vectors a network sees, not normalised: (n, f, 151), or (n, f, 139) for "lodge".

        "lodge" leaves out how the two hands are turned; no joint's position depends on it.
        Raises: ValueError for an unknown name.
        """
        spec = spec_named(name)
        return pack(self.contacts(), self.root, self.pose[:, :, : spec.num_joints])

    @classmethod
    def from_features(
        cls,
        x: Tensor | np.ndarray,
        fps: float = 30.0,
        meta: dict | None = None,
        *,
        name: str = "tcdiffpp",
    ) -> "Motion":
        """Inverse of `features` for x (n, f, d); contacts are cut to [0, 1].

        Joints that the vector leaves out are not turned.
        Raises: ValueError for an unknown name, another d than that name's, or another shape.
        """
        spec = spec_named(name)
        if not isinstance(x, Tensor | np.ndarray):
            raise ValueError(
                f"x is a {type(x).__name__}; give a tensor or array (n, f, {spec.dim})"
            )
        if x.ndim != 3:
            raise ValueError(f"x has shape {tuple(x.shape)}; expected (n, f, {spec.dim})")
        contact, root, pose = unpack(_plain(x), spec)
        return cls(whole_pose(pose), root, fps, contact=contact.clamp(0, 1), meta=meta or {})

    @classmethod
    def from_joints(cls, points: Tensor, fps: float = 30.0, meta: dict | None = None) -> "Motion":
        """A dance from joint positions (n, f, 24, 3), metres, y up: those of SMPL-24, in its order.

        Bones point where they point in ``points``, see `dancediff.motion.from_joints`; of bodies
        with other bone lengths joints lie elsewhere.
        Raises: ValueError naming what is wrong with ``points``.

        >>> still = Motion(torch.eye(3).expand(2, 9, 24, 3, 3), torch.zeros(2, 9, 3))
        >>> again = Motion.from_joints(still.joints())
        >>> torch.allclose(again.joints(), still.joints(), atol=1e-5)
        True
        """
        pose, root = fit_rotations(points)
        return cls(pose, root, fps, meta=meta or {})

    def save(self, path, song=None, *, body: str = "mannequin") -> Path:
        """Write the dance; the suffix decides.

        - ``.npz``: all of this class.
        - ``.mp4``, ``.gif``, ``.png``: pictures; ``song``, or a path, is muxed into an .mp4.
        - ``.html``: a page that plays it in 3-D, with ``song``, from disk.
        - ``.glb``: bodies that move, for 3-D programs; with ``body="mesh"`` a human skin.
        - ``.bvh``, ``.smpl.npz``: a file for each dancer. Of a group ``dance.bvh`` becomes
          ``dance.1.bvh``, ``dance.2.bvh`` ..., the first of which is returned; those of a group
          that was there before are removed.

        Each file appears whole or not at all, its folder is made.
        Raises: ValueError for another suffix, or a body where the format has no choice of one;
        ImportError naming the extra that is missing.
        """
        return files().save(self, path, song, body=body)

    @classmethod
    def load(cls, path, *more) -> "Motion":
        """Read a dance that `save` wrote: .npz, .glb, .bvh, or SMPL arrays in an .npz.

        Also .pkl of EDGE, TCDiff and GCD and .npy of Lodge and FineDance, which are turned upright.

        Several files, such as those of a group's dancers, are put side by side.
        Raises: FileNotFoundError, or ValueError naming the file when it is no such motion.
        """
        return files().load(path, *more)

    @classmethod
    def side_by_side(cls, motions: Sequence["Motion"]) -> "Motion":
        """Dances of the same length as one, the first one's dancers first.

        Its facts are the first one's; where nobody danced one of them, it is synthetic.
        Raises: ValueError when there are none, or lengths, frame rates or skeletons differ.

        >>> solo = Motion(torch.eye(3).expand(1, 30, 24, 3, 3), torch.zeros(1, 30, 3))
        >>> Motion.side_by_side([solo, solo]).num_dancers
        2
        """
        if len(motions) == 0:
            raise ValueError("motions is empty; give one dance or more")
        first = motions[0]
        for other in motions[1:]:
            for name in ("num_frames", "fps"):
                if getattr(other, name) != getattr(first, name):
                    raise ValueError(
                        f"{name}={getattr(other, name)} of one dance, {getattr(first, name)} of "
                        "another; cut or resample them first"
                    )
            if not other.skeleton.is_like(first.skeleton):
                raise ValueError("the dances have different skeletons, or bones of other lengths")
        known = [motion.contact for motion in motions if motion.contact is not None]
        contact = torch.cat(known) if len(known) == len(motions) else None
        pose = torch.cat([motion.pose for motion in motions])
        root, meta = torch.cat([motion.root for motion in motions]), first.meta
        if not first.is_synthetic and any(motion.is_synthetic for motion in motions):
            meta = meta | {"synthetic": True}
        return replace(first, pose=pose, root=root, contact=contact, meta=meta)


def _plain(x: Tensor | np.ndarray) -> Tensor:
    return torch.as_tensor(x).detach().to("cpu", torch.float32)
