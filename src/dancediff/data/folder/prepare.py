"""A folder of motion capture as prepared takes: what `dancediff prepare folder` runs.

Read first: `dancediff.data.folder.make`.

Files in the prepared folder, beside the takes
    folder.toml       what was found out about skeletons, to be checked
    report.md         a row for each take: what was repaired, refused or doubtful
    pictures/         source and result side by side
"""

from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path

from dancediff.atomic import write_text
from dancediff.data.folder.make import Draw, make_folder_take, place_of, song_group
from dancediff.data.folder.posture import Given
from dancediff.data.folder.settings import read_checked, with_checked, write_settings
from dancediff.data.folder.takes import TakePlan, takes_in
from dancediff.data.prepare import prepare
from dancediff.data.prepared import Entry, PreparedData
from dancediff.data.summary import Summary, dropped_line
from dancediff.data.take import Job

PICTURES, REPORT = "pictures", "report.md"
UNMARKED = (".bvh", ".pkl", ".npy")  # formats without a place to say who danced
_WHO = (
    "A {} file cannot say who danced it: its take is called real unless `takes.toml` says "
    "otherwise. Where a model or the choreographer made the motion, "
    'write `kind = "synthetic"` there.'
)


def prepare_folder(
    src, out, *, group: str | None = None, given: Given | None = None, licence: str = "",
    draw: Draw | None = None, **how,
) -> Summary:  # fmt: skip
    """Prepare the motion files of a folder, whatever their kind and skeleton.

    ``group`` and ``given`` are those of `takes_in`; ``licence`` holds for takes of which no table
    tells one; ``draw`` makes the picture of a take; ``how`` is passed to `prepare`. Takes that an
    earlier run made from this folder and that are no longer planned leave ``out``: else dancers
    would stay as solos beside their group, perhaps on the other side of a split.

    Raises: ValueError naming the argument, the file or the entry that is wrong; OSError when
    ``out`` cannot be written.
    """
    out = Path(out)
    if not Path(src).is_dir():
        raise ValueError(f"src={str(src)!r} is no folder; name the one that holds the motion")
    checked = read_checked(out)
    pictures = out / PICTURES
    jobs, files = [], {}
    for plan in one_split_a_song(takes_in(src, group=group, given=given, leave_out=out)):
        bare, givens = with_checked(plan, checked)
        more = {"draw": draw, "pictures": pictures}
        jobs.append(Job(plan.name, partial(make_folder_take, bare, givens, **more)))
        files[plan.name] = plan.labels
    if draw is not None:
        pictures.mkdir(parents=True, exist_ok=True)
    place = place_of(Path(src))

    def ours(row: dict) -> bool:
        """Was this row of the index made from this folder?"""
        return row.get("notes", {}).get("folder") == place

    summary = prepare(jobs, out, replaces=ours, **how)
    for name in summary.dropped:
        (pictures / f"{name}.png").unlink(missing_ok=True)
    entries = [entry for entry in PreparedData(out) if entry.name in files]
    rows = [row for entry in entries for row in entry.notes.get("skeletons", [])]
    write_settings(out, rows, checked)
    text = report(entries, summary.skipped, files)
    text += f"\n{dropped_line(summary.dropped)}\n" if summary.dropped else ""
    write_text(out / REPORT, text)
    return summary


def one_split_a_song(plans: list[TakePlan]) -> list[TakePlan]:
    """The plans, of which those to one song follow the one whose split the table tells.

    Raises: ValueError naming two takes to one song that the table puts into different splits.
    """
    sides: dict[str, TakePlan] = {}
    songs: dict[str, str] = {}  # name of a take: its song
    for plan in plans:
        if plan.song is not None:
            with suppress(OSError):  # told when the take is made
                songs[plan.name] = song_group(plan.song)
        if plan.split is not None and plan.name in songs:
            other = sides.setdefault(songs[plan.name], plan)
            if other.split != plan.split:
                raise ValueError(
                    f"takes.toml puts {other.name!r} in {other.split} and {plan.name!r} in "
                    f"{plan.split}, but both are danced to one song; give them one split"
                )
    return [
        replace(plan, split=sides[songs[plan.name]].split)
        if songs.get(plan.name) in sides
        else plan
        for plan in plans
    ]


def report(entries: list[Entry], skipped: dict[str, str], files: dict) -> str:
    """The table of a folder's takes, in Markdown: repaired, refused, doubtful.

    Below it stands of which files nobody can tell whether they are real.

    >>> print(report([], {"a": "a.bvh: it is cut off"}, {"a": ["a.bvh"]}).splitlines()[-1])
    | a | a.bvh |  | refused | a.bvh: it is cut off |  |
    """
    lines = [
        "| take | files | s, dancers | map, up, unit, fps, rest | repaired, refused | doubt |",
        "| --- | --- | --- | --- | --- | --- |",
    ]
    for entry in entries:
        notes = entry.notes
        kinds = {
            f"{s['map']}, {s['up']}, {s['unit']:.4g}, {s['fps']:.4g}, {s['rest']}"
            for s in notes.get("skeletons", [])
        }
        cells = [
            entry.name,
            ", ".join(notes.get("files", [])),
            f"{entry.frames / entry.fps:.1f}, {entry.dancers}",
            "; ".join(sorted(kinds)) or "SMPL",
            "; ".join(notes.get("repaired", [])),
            "; ".join(notes.get("doubts", [])),
        ]
        lines.append(f"| {' | '.join(cells)} |")
    for name, reason in sorted(skipped.items()):
        where = ", ".join(files.get(name, []))
        lines.append(f"| {name} | {where} |  | refused | {reason} |  |")
    real = [file for e in entries if e.kind == "real" for file in e.notes.get("files", [])]
    if mute := [end for end in UNMARKED if any(file.lower().endswith(end) for file in real)]:
        lines += ["", _WHO.format(" or ".join(mute))]
    return "\n".join(lines) + "\n"
