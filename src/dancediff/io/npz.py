r"""All of a `Motion` in one uncompressed .npz.

Read first: `dancediff.motion.motion` · docs/export.md.

Symbols (axes: n dancers · f frames · j joints)
    rot6d    rotations of the joints, six numbers each       (n, f, j, 6)
    root     pelvis positions, metres, y up                  (n, f, 3)
    contact  foot on the floor, 0..1; may be missing         (n, f, 4)
    offsets  of the joints from their parents, metres        (j, 3)
    header   format, meta, names and parents of the joints   JSON text
"""

import json
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.arrays import COMPRESSED, read_arrays
from dancediff.atomic import atomic_write
from dancediff.export.smpl import load_smpl
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import matrix_to_rot6d, rot6d_to_matrix
from dancediff.motion.skeleton import SMPL24, Skeleton

FORMAT = "dancediff-motion-1"
_PARTS = ("rot6d", "root", "fps", "offsets", "header", "contact")


def check_finite(motion: Motion, path) -> None:
    """Raises: ValueError naming the file for a dance with numbers that are not finite."""
    parts = [part for part in (motion.root, motion.pose, motion.contact) if part is not None]
    if not all(part.isfinite().all() for part in parts):
        raise ValueError(f"the dance for {path} has numbers that are not finite; repair it first")


def save_npz(motion: Motion, path: Path) -> None:
    """Write a dance; the file appears whole or not at all."""
    with atomic_write(path) as part, part.open("wb") as file:
        np.savez(file, **npz_arrays(motion))  # type: ignore[arg-type]


def plain_facts(value, key: str = "meta"):
    """Facts as JSON holds them: numbers and arrays of numpy and torch as numbers and lists.

    Raises: ValueError naming the key of what no JSON holds, its type and the fix.

    >>> plain_facts({"pace": np.float32(1.5), "order": torch.tensor([1, 0])})
    {'pace': 1.5, 'order': [1, 0]}
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, Tensor):
        return plain_facts(value.detach().cpu().tolist(), key)
    if isinstance(value, np.floating):  # a long double stays one in `tolist`
        return float(value)
    if isinstance(value, np.ndarray | np.generic):
        plain = value.tolist()
        if not isinstance(plain, np.generic):
            return plain_facts(plain, key)
    if isinstance(value, dict):
        for name in value:
            if not (name is None or isinstance(name, str | bool | int | float)):
                raise ValueError(
                    f"{key} has the key {name!r}, a {type(name).__name__}; make it a str"
                )
        return {name: plain_facts(one, f"{key}[{name!r}]") for name, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain_facts(one, f"{key}[{k}]") for k, one in enumerate(value)]
    raise ValueError(
        f"{key} is a {type(value).__name__}, which no file of a dance holds; make it a number, "
        "a str, a list or a dict, or leave it out"
    )


def npz_arrays(motion: Motion) -> dict[str, np.ndarray]:
    """What an .npz of a motion holds, in this order.

    Raises: ValueError as `plain_facts`.
    """
    header = {
        "format": FORMAT,
        "meta": plain_facts(motion.meta),
        "names": motion.skeleton.names,
        "parents": motion.skeleton.parents,
    }
    arrays: dict[str, np.ndarray] = {
        "rot6d": matrix_to_rot6d(motion.pose).numpy(),
        "root": motion.root.numpy(),
        "fps": np.array(float(motion.fps)),
        "offsets": motion.skeleton.offsets.numpy(),
        "header": np.array(json.dumps(header)),
    }
    if motion.contact is not None:
        arrays["contact"] = motion.contact.numpy()
    return arrays


def load_npz(path: Path) -> Motion:
    """Read a dance that `save_npz` wrote, or one dancer's SMPL arrays in AMASS's layout.

    Raises: FileNotFoundError, or ValueError naming the file when it is no such motion.
    """
    try:
        data = read_arrays(path, (*_PARTS, "poses"), expand=COMPRESSED)
        if "poses" in data:
            return load_smpl(path)
        if "header" not in data:
            raise ValueError("it has no header")
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
            skeleton=SMPL24 if skeleton.is_like(SMPL24) else skeleton,
            contact=torch.from_numpy(data["contact"]) if "contact" in data else None,
            meta=dict(header["meta"]),
        )
    except FileNotFoundError:
        raise
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RuntimeError) as err:
        raise ValueError(
            f"{path} is no dancediff motion (.npz written by Motion.save): {err}; other files are "
            "read by `dancediff prepare folder`"
        ) from err


def _skeleton(names: list, parents: list, offsets: np.ndarray) -> Skeleton:
    tree = all(type(p) is int and -1 <= p < j for j, p in enumerate(parents))
    if not tree or len(names) != len(parents) or offsets.shape != (len(parents), 3):
        raise ValueError(f"{len(names)} joints with parents {parents} are no tree")
    return Skeleton(tuple(map(str, names)), tuple(parents), torch.from_numpy(offsets))
