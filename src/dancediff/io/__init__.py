"""Dances as files; the suffix of a path says which format.

| suffix | holds | read again |
| --- | --- | --- |
| ``.npz`` | all of a `Motion` | yes |
| ``.bvh``, ``.smpl.npz`` | one dancer a file, for motion capture programs and SMPL viewers | yes |
| ``.glb`` | bodies that move, for 3-D programs | yes, without contacts |
| ``.mp4``, ``.gif``, ``.png`` | pictures; a song is muxed into an .mp4 | no |
| ``.html`` | a page that plays the dance in 3-D, with its song, from disk | no |
"""

from collections.abc import Callable
from functools import partial
from pathlib import Path

from dancediff.io.npz import load_npz, save_npz
from dancediff.motion.files import Files, register
from dancediff.motion.motion import Motion

PER_DANCER = (".bvh", ".smpl.npz")
SUFFIXES = (".npz", ".mp4", ".gif", ".png", ".html", ".glb", *PER_DANCER)
READABLE = (".npz", ".glb", ".bvh")  # .smpl.npz is an .npz


def save(motion: Motion, path, song=None, *, body: str = "mannequin") -> Path:
    """Write a dance in the format of the suffix; see `dancediff.motion.motion.Motion.save`."""
    path = Path(path)
    kind = suffix_of(path)
    if kind not in SUFFIXES:
        raise ValueError(f"suffix {kind!r} of {path} is unknown; use {' '.join(SUFFIXES)}")
    if body != "mannequin" and kind != ".glb":
        raise ValueError(f"body={body!r} goes with .glb only, not with {path}; leave it out")
    write = _writer(kind, song, body)
    if kind not in PER_DANCER or motion.num_dancers == 1:
        write(motion, path)
        return path
    numbered = [path.with_suffix(f".{k + 1}{path.suffix}") for k in range(motion.num_dancers)]
    for k, name in enumerate(numbered):
        write(motion.dancer(k), name)
    return numbered[0]


def load(path, *more) -> Motion:
    """Read a dance in a format that can be read; see `dancediff.motion.motion.Motion.load`."""
    motions = [_reader(Path(name))(Path(name)) for name in (path, *more)]
    return motions[0] if len(motions) == 1 else Motion.side_by_side(motions)


def suffix_of(path: Path) -> str:
    """``.smpl.npz`` for SMPL arrays, else what pathlib says.

    >>> suffix_of(Path("dance.smpl.npz")), suffix_of(Path("my.dance.npz"))
    ('.smpl.npz', '.npz')
    """
    two = "".join(path.suffixes[-2:])
    return two if two in SUFFIXES else path.suffix


def _writer(kind: str, song, body: str) -> Callable[[Motion, Path], object]:
    """What writes a format; only that one's libraries are imported."""
    if kind == ".npz":
        return save_npz
    if kind == ".bvh":
        from dancediff.export.bvh import save_bvh

        return save_bvh
    if kind == ".smpl.npz":
        from dancediff.export.smpl import save_smpl

        return save_smpl
    if kind == ".glb":
        from dancediff.export.gltf import save_glb

        return partial(save_glb, body=body)
    if kind == ".png":
        from dancediff.viz.plots import save_filmstrip as write
    elif kind == ".html":
        from dancediff.viz.player import save_player as write
    else:
        from dancediff.viz.video import save_video as write
    return partial(write, song=song)


def _reader(path: Path) -> Callable[[Path], Motion]:
    """What reads a format; whatever has another suffix is tried as an .npz."""
    if path.suffix == ".bvh":
        from dancediff.export.bvh import load_bvh

        return load_bvh
    if path.suffix == ".glb":
        from dancediff.export.gltf import load_glb

        return load_glb
    return load_npz


def _picture(motion: Motion) -> str:
    from dancediff.viz.still import dance_html

    return dance_html(motion)


register(Files(save, load, _picture, READABLE))
