r"""AIST++: short solos in ten street dance genres, 60 frames a second.

    motions/<take>.pkl      smpl_poses (f, 72) axis-angle, smpl_trans (f, 3), smpl_scaling (1,)
    splits/crossmodal_train.txt, ..._val.txt, ..._test.txt      one take a line
    ignore_list.txt         takes whose reconstruction failed
    wavs/<take>.wav         or musics/<music>.wav: the music is not part of AIST++ itself

A take is called gBR_sBM_cAll_d04_mBR0_ch01: genre, situation, camera, dancer, music, choreography.
y is up, and the root's path in metres is smpl_trans / smpl_scaling. The name of the music tells its
tempo.

Symbols (axes: f frames)
"""

import re
from functools import partial
from pathlib import Path

import numpy as np

from dancediff.data.formats import (
    find_song,
    group_takes,
    plain_array,
    read_names,
    read_splits,
    smpl_take,
)
from dancediff.data.take import SPLITS, Job

RECORDED_FPS = 60
SOURCE = "AIST++ (Li et al., ICCV 2021), google.github.io/aistplusplus_dataset"
LICENCE = "AIST++ annotations: CC BY 4.0; music: AIST Dance Video Database, research only"
GENRES = {  # in the order of the genre ids 0 to 9
    "BR": "Break", "PO": "Pop", "LO": "Lock", "MH": "Middle Hip-hop", "LH": "LA style Hip-hop",
    "HO": "House", "WA": "Waack", "KR": "Krump", "JS": "Street Jazz", "JB": "Ballet Jazz",
}  # fmt: skip
_TAKE = re.compile(rf"g({'|'.join(GENRES)})_s\w\w_c\w+_d\d\d_m({'|'.join(GENRES)})(\d)_ch\d\d")


def aistpp_jobs(src) -> list[Job]:
    """One job for each take of the three cross-modal lists that is not in the ignore list.

    Takes to the same music share a group within their split. Motions that no list names are not
    part of the protocol and are left out.

    Source: the lists of AIST++; EDGE uses train and test, Lodge tests on val and test together.

    Raises: ValueError when ``src`` has no lists, a take in two of them, or a name of another form.
    """
    src = Path(src)
    if not (src / "motions").is_dir():
        raise ValueError(f"{src / 'motions'} does not exist; unpack AIST++ there")
    folder = src / "splits" if (src / "splits").is_dir() else src
    splits = read_splits({split: folder / f"crossmodal_{split}.txt" for split in SPLITS})
    wrong = [name for name in splits if not _TAKE.fullmatch(name)]
    if wrong:
        raise ValueError(f"{folder}: {wrong[0]!r} is no name of a take, such as {_EXAMPLE}")
    groups = group_takes(splits, music_id)
    ignored = {
        name
        for path in {src / "ignore_list.txt", folder / "ignore_list.txt"}
        if path.is_file()
        for name in read_names(path)
    }
    songs = [src / folder for folder in ("wavs", "wav", "musics", "music")]
    jobs = []
    for name in [name for name in splits if name not in ignored]:
        music, path = music_id(name), src / "motions" / f"{name}.pkl"
        song = find_song(songs, [name, music])
        notes = {"music_id": music, "tempo": music_tempo(music)}
        facts: dict = {"split": splits[name], "group": f"aistpp {groups[name]}", "notes": notes}
        facts |= {"source": SOURCE, "licence": LICENCE, "genre": GENRES[name[1:3]]}
        read = partial(smpl_take, f"aistpp_{name}", path, song, read_poses, RECORDED_FPS)
        jobs.append(Job(f"aistpp_{name}", partial(read, **facts)))
    return jobs


_EXAMPLE = "gBR_sBM_cAll_d04_mBR0_ch01"


def music_id(name: str) -> str:
    """The music of a take.

    >>> music_id("gBR_sBM_cAll_d04_mBR0_ch01")
    'mBR0'
    """
    return name.split("_")[4]


def music_tempo(music: str) -> int:
    """Beats per minute of a music, from its name: house starts at 110, all others at 80.

    >>> music_tempo("mBR0"), music_tempo("mHO5")
    (80, 135)
    """
    digit = int(music[-1])
    return 110 + 5 * digit if music[1:3] == "HO" else 80 + 10 * digit


def read_poses(data) -> tuple[np.ndarray, np.ndarray]:
    """Axis-angle vectors (1, f, 72) and root path (1, f', 3) in metres of a file's content.

    Raises: ValueError naming the field that is missing or has another shape.
    """
    poses = plain_array(data.get("smpl_poses"), "smpl_poses", (None, 72))
    trans = plain_array(data.get("smpl_trans"), "smpl_trans", (None, 3))
    scaling = np.asarray(data.get("smpl_scaling", np.nan))
    if scaling.dtype.kind not in "fiu" or scaling.size != 1 or not 1e-3 < scaling.item() < 1e6:
        raise ValueError("smpl_scaling is missing, or no single positive number")
    return poses[None], trans[None] / scaling.item()
