r"""``folder.toml``: what was found out about skeletons, for the user to look at and correct.

    [[skeleton]]
    checked = false      # set to true once the lines below are right; then they are used as given
    files = ["a.bvh", "b.bvh"]
    map = "guessed"
    up = "z"
    unit = 0.01
    fps = 120.0
    rest = "file"        # or the number of a frame in a T-pose
    [skeleton.joints]
    root = "Hips"

Entries that are not checked are written anew by every run; checked ones stay as they are.
"""

import json
import tomllib
from dataclasses import fields, replace
from pathlib import Path

from dancediff.atomic import write_text
from dancediff.data.folder.posture import Given
from dancediff.data.folder.takes import TakePlan

NAME = "folder.toml"
_GIVEN = tuple(f.name for f in fields(Given) if f.name != "joints")
_HEAD = """# What was found out about the skeletons. Correct a table, set checked = true, run the
# same `dancediff prepare folder` again: its files are then made with what stands here.
"""


def read_checked(out: Path) -> list[dict]:
    """The tables that the user has checked.

    Raises: ValueError naming the file and what is wrong in it.
    """
    path = out / NAME
    if not path.is_file():
        return []
    try:
        rows = tomllib.loads(path.read_text(encoding="utf-8-sig")).get("skeleton", [])
        checked = [row for row in rows if row.get("checked") is True]
        for row in checked:
            given_in(row)
            if not all(isinstance(file, str) for file in row["files"]):
                raise TypeError("files must be a list of names")
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as err:
        raise ValueError(f"{str(path)!r} cannot be used: {err}; correct or delete it") from err
    return checked


def given_in(row: dict) -> Given:
    """What a checked table gives."""
    return Given(joints=dict(row["joints"]), **{key: row[key] for key in _GIVEN if key in row})


def with_checked(plan: TakePlan, checked: list[dict]) -> tuple[TakePlan, tuple[Given, ...]]:
    """The plan, and what is given for each of its files."""
    rows = [next((r for r in checked if label in r["files"]), None) for label in plan.labels]
    givens = [plan.given if row is None else given_in(row) for row in rows]
    return replace(plan, given=Given()), tuple(givens)


def write_settings(out: Path, skeletons: list[dict], checked: list[dict]) -> Path:
    """Write the checked tables, then one for each skeleton that was found in other files.

    ``skeletons`` have file, map, joints, up, unit, fps, rest.
    """
    known = {file for row in checked for file in row["files"]}
    tables = [dict(row) for row in checked]
    for row in skeletons:
        if row["file"] in known:
            continue
        same = {key: value for key, value in row.items() if key != "file"}
        for table in tables[len(checked) :]:
            if all(table[key] == value for key, value in same.items()):
                table["files"].append(row["file"])
                break
        else:
            tables.append({"checked": False, "files": [row["file"]], **same})
    path = out / NAME
    write_text(path, _HEAD + "".join(map(_table, tables)))
    return path


def _toml(value) -> str:
    return json.dumps(value, ensure_ascii=False)  # TOML has no pairs of escapes for an emoji


def _table(row: dict) -> str:
    joints = row["joints"]
    lines = ["", "[[skeleton]]"]
    lines += [f"{key} = {_toml(value)}" for key, value in row.items() if key != "joints"]
    lines += ["[skeleton.joints]"]
    lines += [f"{ours} = {_toml(theirs)}" for ours, theirs in joints.items()]
    return "\n".join(lines) + "\n"
