r"""`Motion`: a dance of one or more people, and its file format.

Symbols (axes: n dancers · f frames · j joints)
    pose     rotation of each joint relative to its parent   (n, f, j, 3, 3)
    root     pelvis position, metres, y up                   (n, f, 3)
    contact  foot on the floor, 0..1                         (n, f, 4)
"""

import io
import json
import math
import struct
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.atomic import atomic_write
from dancediff.motion.contact import foot_contact
from dancediff.motion.representation import pack, spec_named, unpack, whole_pose
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix
from dancediff.motion.skeleton import SMPL24, Skeleton, forward_kinematics

FORMAT = "dancediff-motion-1"
TOLD = ("model", "song", "seed", "genre", "kind")  # of a dance's meta, in its one line
MOST_FPS = 1000.0  # no camera for motion capture is faster; metrics smooth over seconds of frames
PER_DANCER = (".bvh", ".smpl.npz")
SUFFIXES = (".npz", ".mp4", ".gif", ".png", ".html", ".glb", *PER_DANCER)
_PARTS = ("rot6d", "root", "fps", "offsets", "header", "contact")


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
        if not 0 < self.fps <= MOST_FPS:
            raise ValueError(f"fps={self.fps:g} must be above 0 and at most {MOST_FPS:g}")

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
        from dancediff.viz.still import dance_html

        return {"text/plain": repr(self), "text/html": dance_html(self)}

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

    def frames(self, start: int, stop: int) -> "Motion":
        """The frames start..stop-1, as with a slice of a list.

        Raises: ValueError when no frame is left.
        """
        part = slice(start, stop)
        if self.root[:, part].shape[1] == 0:
            raise ValueError(f"frames({start}, {stop}) is empty; there are {self.num_frames}")
        contact = None if self.contact is None else self.contact[:, part]
        return replace(self, pose=self.pose[:, part], root=self.root[:, part], contact=contact)

    def seconds(self, start: float, stop: float) -> "Motion":
        """The part between two times."""
        return self.frames(round(start * self.fps), round(stop * self.fps))

    def dancer(self, k: int) -> "Motion":
        """One dancer as a solo."""
        contact = None if self.contact is None else self.contact[k : k + 1]
        return replace(self, pose=self.pose[k : k + 1], root=self.root[k : k + 1], contact=contact)

    def features(self, name: str = "tcdiffpp") -> Tensor:
        """The vectors a network sees, not normalised: (n, f, 151), or (n, f, 139) for "lodge".

        Contacts are computed from the joints where the motion carries none. "lodge" leaves out how
        the two hands are turned; no joint's position depends on it.
        Raises: ValueError for an unknown name.
        """
        spec = spec_named(name)
        contact = foot_contact(self.joints()) if self.contact is None else self.contact
        return pack(contact, self.root, self.pose[:, :, : spec.num_joints])

    @classmethod
    def from_features(
        cls, x: Tensor, fps: float = 30.0, meta: dict | None = None, *, name: str = "tcdiffpp"
    ) -> "Motion":
        """Inverse of `features` for x (n, f, d); contacts are cut to [0, 1].

        Joints that the vector leaves out are not turned.
        Raises: ValueError for an unknown name, or another d than that name's.
        """
        contact, root, pose = unpack(x.detach().cpu().float(), spec_named(name))
        return cls(whole_pose(pose), root, fps, contact=contact.clamp(0, 1), meta=meta or {})

    def save(self, path, song=None, *, body: str = "mannequin") -> Path:
        """Write the dance; the suffix decides.

        - ``.npz``: all of this class.
        - ``.mp4``, ``.gif``, ``.png``: pictures; ``song`` is muxed into an .mp4.
        - ``.html``: a page that plays it in 3-D, with ``song``, from disk.
        - ``.glb``: bodies that move, for 3-D programs; with ``body="mesh"`` a human skin.
        - ``.bvh``, ``.smpl.npz``: a file for each dancer. Of a group ``dance.bvh`` becomes
          ``dance.1.bvh``, ``dance.2.bvh`` ..., the first of which is returned.

        Each file appears whole or not at all.
        Raises: ValueError for another suffix, or a body where the format has no choice of one;
        ImportError naming the extra that is missing.
        """
        path = Path(path)
        kind = suffix_of(path)
        if kind not in SUFFIXES:
            raise ValueError(f"suffix {kind!r} of {path} is unknown; use {' '.join(SUFFIXES)}")
        if body != "mannequin" and kind != ".glb":
            raise ValueError(f"body={body!r} goes with .glb only, not with {path}; leave it out")
        if kind in PER_DANCER:
            return self._save_dancers(path, kind)
        if kind == ".npz":
            with atomic_write(path) as part, part.open("wb") as file:
                np.savez(file, **npz_arrays(self))
        elif kind in (".mp4", ".gif"):
            from dancediff.viz.video import save_video

            save_video(self, path, song=song)
        elif kind == ".png":
            from dancediff.viz.plots import save_filmstrip

            save_filmstrip(self, path, song=song)
        elif kind == ".html":
            from dancediff.viz.player import save_player

            save_player(self, path, song=song)
        else:
            from dancediff.export.gltf import save_glb

            save_glb(self, path, body=body)
        return path

    def _save_dancers(self, path: Path, kind: str) -> Path:
        from dancediff.export import bvh, smpl

        write = {".bvh": bvh.save_bvh, ".smpl.npz": smpl.save_smpl}[kind]
        if self.num_dancers == 1:
            return write(self, path)
        numbered = [path.with_suffix(f".{k + 1}{path.suffix}") for k in range(self.num_dancers)]
        for k, name in enumerate(numbered):
            write(self.dancer(k), name)
        return numbered[0]

    @classmethod
    def load(cls, path, *more) -> "Motion":
        """Read a dance that `save` wrote: .npz, .glb, .bvh, or SMPL arrays in an .npz.

        Several files, such as those of a group's dancers, are put side by side.
        Raises: FileNotFoundError, or ValueError naming the file when it is no such motion.
        """
        motions = [_load(Path(name)) for name in (path, *more)]
        return motions[0] if len(motions) == 1 else cls.side_by_side(motions)

    @classmethod
    def side_by_side(cls, motions: Sequence["Motion"]) -> "Motion":
        """Dances of the same length as one, the first one's dancers first.

        Raises: ValueError when lengths, frame rates or skeletons differ.

        >>> solo = Motion(torch.eye(3).expand(1, 30, 24, 3, 3), torch.zeros(1, 30, 3))
        >>> Motion.side_by_side([solo, solo]).num_dancers
        2
        """
        first = motions[0]
        for other in motions[1:]:
            for name in ("num_frames", "fps"):
                if getattr(other, name) != getattr(first, name):
                    raise ValueError(
                        f"{name}={getattr(other, name)} of one dance, {getattr(first, name)} of "
                        "another; cut or resample them first"
                    )
            if other.skeleton.names != first.skeleton.names:
                raise ValueError("the dances have different skeletons")
        parts = [motion.contact for motion in motions]
        contact = None if any(part is None for part in parts) else torch.cat(parts)
        pose = torch.cat([motion.pose for motion in motions])
        return replace(
            first, pose=pose, root=torch.cat([motion.root for motion in motions]), contact=contact
        )


def suffix_of(path: Path) -> str:
    """``.smpl.npz`` for SMPL arrays, else what pathlib says.

    >>> suffix_of(Path("dance.smpl.npz")), suffix_of(Path("my.dance.npz"))
    ('.smpl.npz', '.npz')
    """
    two = "".join(path.suffixes[-2:])
    return two if two in SUFFIXES else path.suffix


def _load(path: Path) -> Motion:
    if path.suffix == ".bvh":
        from dancediff.export.bvh import load_bvh

        return load_bvh(path)
    if path.suffix == ".glb":
        from dancediff.export.gltf import load_glb

        return load_glb(path)
    return _read_npz(path)


def _plain(x: Tensor) -> Tensor:
    return torch.as_tensor(x).detach().to("cpu", torch.float32)


def npz_arrays(motion: Motion) -> dict[str, np.ndarray]:
    """What an .npz of a motion holds, in this order."""
    arrays = {
        "rot6d": matrix_to_rot6d(motion.pose).numpy(),
        "root": motion.root.numpy(),
        "fps": np.float64(motion.fps),
        "offsets": motion.skeleton.offsets.numpy(),
        "header": np.array(
            json.dumps(
                {
                    "format": FORMAT,
                    "meta": motion.meta,
                    "names": motion.skeleton.names,
                    "parents": motion.skeleton.parents,
                }
            )
        ),
    }
    if motion.contact is not None:
        arrays["contact"] = motion.contact.numpy()
    return arrays


def _read_npz(path: Path) -> Motion:
    try:
        data = read_arrays(path, (*_PARTS, "poses"))
        if "poses" in data:
            from dancediff.export.smpl import load_smpl

            return load_smpl(path)
        header = json.loads(str(data["header"]))
        if header.get("format") != FORMAT:
            raise ValueError(f"format is {header.get('format')!r}, not {FORMAT!r}")
        if data["rot6d"].shape[3:] != (6,):
            raise ValueError(f"rot6d has shape {data['rot6d'].shape}; expected (n, f, j, 6)")
        skeleton = _skeleton(header["names"], header["parents"], data["offsets"])
        return Motion(
            pose=rot6d_to_matrix(torch.from_numpy(data["rot6d"])),
            root=torch.from_numpy(data["root"]),
            fps=float(data["fps"]),
            skeleton=SMPL24 if skeleton.names == SMPL24.names else skeleton,
            contact=torch.from_numpy(data["contact"]) if "contact" in data else None,
            meta=dict(header["meta"]),
        )
    except FileNotFoundError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as err:
        raise ValueError(
            f"{path} is no dancediff motion (.npz written by Motion.save): {err}"
        ) from err


def _skeleton(names: list, parents: list, offsets: np.ndarray) -> Skeleton:
    tree = all(type(p) is int and -1 <= p < j for j, p in enumerate(parents))
    if not tree or len(names) != len(parents) or offsets.shape != (len(parents), 3):
        raise ValueError(f"{len(names)} joints with parents {parents} are no tree")
    return Skeleton(tuple(map(str, names)), tuple(parents), torch.from_numpy(offsets))


def read_arrays(path, names: tuple[str, ...] = ()) -> dict[str, np.ndarray]:
    """The arrays of an uncompressed .npz, all or those with the ``names`` that are there.

    No memory is taken for more than the file holds, whatever its headers promise.

    Raises: FileNotFoundError, or ValueError telling what is broken.
    """
    path = Path(path)
    size = path.stat().st_size
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
            if sum(max(m.file_size, m.compress_size) for m in members) > size or any(
                m.compress_type != zipfile.ZIP_STORED for m in members
            ):
                raise ValueError("its arrays are compressed, or larger than the file itself")
            named = {m.filename.removesuffix(".npy"): m for m in members}
            keys = [name for name in named if name in names] if names else named
            return {name: _array(archive.read(named[name])) for name in keys}
    except (OSError, zipfile.BadZipFile, EOFError, SyntaxError, RuntimeError, struct.error) as err:
        # a broken zip may even ask for a place before the file's first byte (OSError)
        raise ValueError(f"{type(err).__name__}: {err}") from err


def _array(content: bytes) -> np.ndarray:
    """An array from the bytes of an .npy file."""
    file = io.BytesIO(content)
    if np.lib.format.read_magic(file) != (1, 0):
        raise ValueError("it has an array of another version than 1.0")
    shape, fortran, dtype = np.lib.format.read_array_header_1_0(file)
    if dtype.hasobject or math.prod(shape) * dtype.itemsize != len(content) - file.tell():
        raise ValueError(f"it has an array {shape} of {dtype} that does not fill its place")
    flat = np.frombuffer(bytearray(content), dtype, offset=file.tell())
    return flat.reshape(shape, order="F" if fortran else "C")
