r"""AIOZ-GDance: groups of two to seven people, dancing in videos, 30 frames a second.

Read first: data_prep/README.md.

    motions_smpl/<take>.pkl     smpl_poses (n, f, 72) axis-angle, root_trans (n, f, 3) metres, y up
    musics/<take>.wav           from the same moment on (or musics438/, or music/)
    train_split_sequence_names.txt, val_…, test_…     one take a line
    split_sequence_names.txt                          instead: all takes, in no split
    *.csv                       of a later release: dance style and music genre of each take

A take is called <video>_<clip>_<first frame>_<last frame>. Some files have only 21 body joints in
``smpl_poses``, without root and hands; the root's rotation is then in ``smpl_orients``. Body shapes
(``smpl_betas``) are not used, by anybody.

Symbols (axes: n dancers · f frames)
"""

import csv
from functools import partial
from pathlib import Path

import numpy as np

from dancediff.axes import FPS
from dancediff.data.formats import (
    drawn_split,
    find_song,
    group_takes,
    plain_array,
    read_names,
    read_splits,
    smpl_take,
)
from dancediff.data.names import take_name
from dancediff.data.take import SPLITS, DanceTake, Job

ONE_LIST = "split_sequence_names.txt"
SONGS = ("musics", "musics438", "music")  # of the README, and of copies
WIDTH = 72  # 24 joints
WITHOUT_HANDS = 66
SOURCE = "AIOZ-GDance (Le et al., CVPR 2023), github.com/aioz-ai/AIOZ-GDANCE"
LICENCE = "AIOZ-GDance licence: non-commercial scientific research, no redistribution"


def aioz_jobs(src) -> list[Job]:
    """One job for each take of the three lists, and for each motion file that no list names.

    The latter fail when they are made, so that they are reported. Takes of all group sizes are
    kept; what trains on them chooses. Takes of one video share a group within their split. Of the
    README's one list a tenth of the videos are for validation, none for a test.

    Source: the data set's README.  Differs: TCDiff and TCDiff++ have no test set of their own; they
    test on the list "val".

    Raises: ValueError when ``src`` has no motions, no lists, or a take in two of them.
    """
    src = Path(src)
    files = {path.stem: path for path in sorted((src / "motions_smpl").glob("*.pkl"))}
    if not files:
        raise ValueError(f"{src / 'motions_smpl'} holds no .pkl files; unpack AIOZ-GDance there")
    splits = _splits(src)
    groups = group_takes(splits, _video)
    labels = _labels(src)
    jobs = []
    for name, split in splits.items():
        path = src / "motions_smpl" / f"{name}.pkl"
        song = find_song([src / folder for folder in SONGS], [name])
        label = labels.get(name, {})
        facts: dict = {"split": split, "group": f"aioz {groups[name]}", "source": SOURCE}
        facts |= {"licence": LICENCE, "genre": label.get("genre") or label.get("style")}
        facts |= {"notes": {"video": _video(name), **label}}
        read = partial(smpl_take, f"aioz_{name}", path, song, read_poses, FPS)
        jobs.append(Job(f"aioz_{name}", partial(read, **facts)))
    return jobs + [
        Job(f"aioz_{take_name(name)}", partial(_refuse, path))
        for name, path in files.items()
        if name not in splits
    ]


def read_poses(data) -> tuple[np.ndarray, np.ndarray]:
    """Axis-angle vectors (n, f, 72) and root path (n, f', 3) of a file's content.

    Where hands are missing they get no rotation, as in the code of GCD.

    Raises: ValueError naming the field that is missing or has another shape.
    """
    fields = {key: data[key] for key in ("smpl_poses", "smpl_orients", "root_trans") if key in data}
    solo = getattr(fields.get("smpl_poses"), "ndim", 3) == 2  # one dancer without an axis for it
    if solo:
        fields = {k: v[None] if isinstance(v, np.ndarray) else v for k, v in fields.items()}
    poses = plain_array(fields.get("smpl_poses"), "smpl_poses", (None, None, None))
    trans = plain_array(fields.get("root_trans"), "root_trans", (None, None, 3))
    if poses.shape[2] < WIDTH and "smpl_orients" in fields:
        shape = (*poses.shape[:2], 3)
        poses = np.concatenate(
            [plain_array(fields["smpl_orients"], "smpl_orients", shape), poses], -1
        )
    if poses.shape[2] == WITHOUT_HANDS:
        poses = np.pad(poses, ((0, 0), (0, 0), (0, WIDTH - WITHOUT_HANDS)))
    if poses.shape[2] != WIDTH:
        raise ValueError(
            f"smpl_poses has {poses.shape[2]} numbers a frame, root included; expected {WIDTH}, or "
            f"{WITHOUT_HANDS} without hands"
        )
    return poses, trans


def _splits(src: Path) -> dict[str, str]:
    lists = {split: src / f"{split}_{ONE_LIST}" for split in SPLITS}
    if (src / ONE_LIST).is_file() and not any(path.is_file() for path in lists.values()):
        return {name: drawn_split(f"aioz {_video(name)}") for name in read_names(src / ONE_LIST)}
    return read_splits(lists)


def _video(name: str) -> str:
    return name.rsplit("_", 3)[0]


def _refuse(path: Path) -> DanceTake:
    raise ValueError(f"{path} is in none of the lists of takes, so its split is not known")


def _labels(src: Path) -> dict[str, dict[str, str]]:
    """Genre and style of takes, from tables whose first column is the take's name.

    Columns are found by the words genre and style in their titles.
    """
    labels: dict[str, dict[str, str]] = {}
    for path in sorted(src.glob("*.csv")):
        try:
            rows = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
        except (OSError, ValueError, csv.Error) as err:
            raise ValueError(f"{path} cannot be read as a table of labels: {err}") from err
        for kind in ("genre", "style"):
            columns = [
                k for k, title in enumerate(rows[0] if rows else []) if kind in title.lower()
            ]
            for row in rows[1:]:
                if columns and len(row) > columns[0] and row[columns[0]].strip():
                    labels.setdefault(row[0].strip(), {})[kind] = row[columns[0]].strip()
    return labels
