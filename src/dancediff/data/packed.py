r"""The takes of a split in two memory maps, so that windows cost no more than a read.

Read first: `dancediff.data.prepared`.

What is packed are whole takes; a window is a view into them. (Ten overlapping copies of every
frame, as the released data sets keep them, would read no faster.)

Symbols (axes: n dancers · f frames · d motion, m music features)
    x.npy   motion vectors of all takes, one dancer after the other   (sum n f, d)   float32
    M.npy   music features of all takes, one song after the other     (sum songs f, m)
"""

import json
import shutil
import stat
import tempfile
from dataclasses import asdict, dataclass, fields
from hashlib import sha256
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from dancediff.data.cache import code_digest
from dancediff.data.prepared import PACKING, Entry, PreparedData
from dancediff.data.take import DanceTake
from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import SMPL24
from dancediff.music.features import NUM_FEATURES

NOT_AS_SAID = "take {!r} is not as its index says; prepare it anew"


@dataclass(frozen=True)
class Place:
    """Where a take lies in the maps: from row ``x`` on n f rows, from row ``M`` on songs f rows."""

    entry: Entry
    x: int
    M: int


class PackedTakes:
    """Takes of a split as memory maps under the folder's ``cache/``, packed when first asked for.

    Takes without music are left out. Maps are opened when used, so that the object may be sent to
    other processes; what is read may be changed, the files never are.

    Raises: ValueError when the folder is not prepared or one of its takes is damaged.
    """

    def __init__(self, data: PreparedData | str | Path, split: str = "train"):
        data = data if isinstance(data, PreparedData) else PreparedData(data)
        self.places, x, M = [], 0, 0
        for entry in data.split(split):
            if entry.songs:
                self.places.append(Place(entry, x, M))
                x += entry.dancers * entry.frames
                M += entry.songs * entry.frames
        self.shapes = {"x": (x, TCDIFFPP.dim), "M": (M, NUM_FEATURES)}
        rows = json.dumps([asdict(place) for place in self.places], sort_keys=True)
        key = sha256(f"{code_digest()} {rows}".encode()).hexdigest()[:12]
        self.folder = data.folder / "cache" / f"packed-{split}-{key}"
        self._maps: dict[str, np.ndarray] = {}
        if self.places and not self.folder.is_dir():
            self._write(data)

    def __len__(self) -> int:
        return len(self.places)

    def __getstate__(self) -> dict:
        return self.__dict__ | {"_maps": {}}  # a memory map would be sent as all its numbers

    def _map(self, name: str) -> np.ndarray:
        if name not in self._maps:
            path = self.folder / f"{name}.npy"
            try:
                self._maps[name] = np.load(path, mmap_mode="c")
            except PermissionError as err:
                raise PermissionError(
                    err.errno, "may not be read; ask its owner for the right to", str(path)
                ) from err
            except (OSError, ValueError, EOFError, SyntaxError) as err:
                raise ValueError(
                    f"{str(path)!r} is damaged ({err}); delete the folder it is in, which is made "
                    "anew"
                ) from err
        return self._maps[name]

    def _write(self, data: PreparedData) -> None:
        for place in self.places:  # before any file is made as large as the index says
            _check_size(place.entry, data.folder)
        self.folder.parent.mkdir(parents=True, exist_ok=True)
        part = Path(tempfile.mkdtemp(prefix=PACKING, dir=self.folder.parent))
        part.chmod(stat.S_IMODE(self.folder.parent.stat().st_mode))  # mkdtemp lets nobody else in
        try:
            x, M = (
                np.lib.format.open_memmap(part / f"{name}.npy", "w+", np.float32, shape)
                for name, shape in self.shapes.items()
            )
            for place in self.places:
                self._put(place, data, x, M)
            x.flush()
            M.flush()
            try:
                part.replace(self.folder)
            except OSError:
                if not self.folder.is_dir():  # or another process was faster
                    raise
        finally:
            shutil.rmtree(part, ignore_errors=True)

    @staticmethod
    def _put(place: Place, data: PreparedData, x: np.ndarray, M: np.ndarray) -> None:
        take, entry = data.load(place.entry), place.entry
        motion = take.motion.features().flatten(0, 1)
        songs = torch.cat(take.songs)
        expected = (entry.dancers * entry.frames, entry.songs * entry.frames)
        if (len(motion), len(songs)) != expected:
            raise ValueError(NOT_AS_SAID.format(entry.name))
        x[place.x : place.x + len(motion)] = motion
        M[place.M : place.M + len(songs)] = songs

    def motion(self, k: int, start: int = 0, stop: int | None = None) -> Tensor:
        """Motion vectors of take k, not normalised, frames start..stop-1: (n, f, d)."""
        return self._part("x", k, self.places[k].entry.dancers, slice(start, stop))

    def music(self, k: int, start: int = 0, stop: int | None = None) -> Tensor:
        """Features of all songs of take k, raw: (songs, f, m); the first is the take's own."""
        return self._part("M", k, self.places[k].entry.songs, slice(start, stop))

    def _part(self, name: str, k: int, count: int, frames: slice) -> Tensor:
        first, f = getattr(self.places[k], name), self.places[k].entry.frames
        rows = self._map(name)[first : first + count * f]
        return torch.from_numpy(rows.reshape(count, f, -1)[:, frames])

    def takes(self, *, num_frames: int = 1, max_dancers: int | None = None) -> list[DanceTake]:
        """All takes of at least ``num_frames`` and up to ``max_dancers``; they stay on disk."""
        return [
            self._take(k)
            for k, place in enumerate(self.places)
            if place.entry.frames >= num_frames
            and place.entry.dancers <= (max_dancers or place.entry.dancers)
        ]

    def _take(self, k: int) -> DanceTake:
        entry, songs = self.places[k].entry, self.music(k)
        same = {field.name for field in fields(DanceTake)} & set(entry.__dict__)
        origin = {name: getattr(entry, name) for name in same}
        return DanceTake(dance=self.motion(k), M=songs[0], M_other=songs[1:], **origin)


def _check_size(entry: Entry, folder: Path) -> None:
    """A file of plain arrays that holds as many frames as its index says is at least so large."""
    path = folder / entry.file
    if not path.is_file():
        raise ValueError(f"{str(path)!r} is missing; run `dancediff prepare` again")
    pose = SMPL24.num_joints * 6  # numbers of four bytes a dancer and frame
    numbers = entry.frames * (entry.dancers * pose + entry.songs * NUM_FEATURES)
    if path.stat().st_size < 4 * numbers:
        raise ValueError(NOT_AS_SAID.format(entry.name))
