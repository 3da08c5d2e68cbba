"""A static page of many dances: a picture, the metrics and a player of each; failures stay in.

Read first: `dancediff.viz.player`.

    gallery/
        index.html          the table
        NAME.html           a player for each dance

No server is needed, and nothing is fetched: the folder can be zipped and sent.
"""

import html
import re
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

from tqdm.auto import tqdm

from dancediff.atomic import write_text
from dancediff.metrics.report import evaluate_dances
from dancediff.motion.files import files
from dancediff.motion.motion import Motion
from dancediff.viz.player import PAGE, SHOWN, save_player
from dancediff.viz.plots import filmstrip_page
from dancediff.viz.style import as_png, data_url


@dataclass
class Gallery:
    """What `save_gallery` made: the page, and which files are no dances, with the reason."""

    index: Path
    dances: list[str] = field(default_factory=list)
    failed: dict[str, str] = field(default_factory=dict)


def save_gallery(folder, out, song=None, *, progress: bool = False) -> Gallery:
    """Write a page with all dances of a folder and of the folders in it.

    Dances are the files that `dancediff evaluate` reads, too. One that cannot be read or measured
    has its line with the reason. ``song`` is played with each, and gives the beats of those that
    bring none.

    Raises: ValueError when the folder holds no such file.
    """
    folder, out = Path(folder), Path(out)
    found = files().find(folder)
    out.mkdir(parents=True, exist_ok=True)
    made, rows = Gallery(out / "index.html"), []
    pages: set[str] = set()
    for path in tqdm(found, desc="gallery", unit="dance", disable=not progress):
        name = path.relative_to(folder).as_posix()
        try:
            rows.append(_row(name, path, out / _page_name(name, pages), song))
            made.dances.append(name)
        except (ValueError, ArithmeticError, RuntimeError) as err:  # shown, not hidden
            made.failed[name] = " ".join(str(err).split())
            rows.append(_failure(name, made.failed[name]))
    write_text(made.index, _page(folder.name or "dances", rows, made, song))
    return made


def _page_name(name: str, taken: set[str]) -> str:
    """The file of a dance's player, which no other dance has; added to ``taken``.

    >>> pages = set()
    >>> _page_name("a/b.npz", pages), _page_name("a_b.npz", pages)
    ('a_b.npz.html', 'a_b.npz_2.html')
    """
    stem = name.replace("/", "_")
    page, k = f"{stem}.html", 2
    while page.lower() in taken:  # a disk may ignore case
        page, k = f"{stem}_{k}.html", k + 1
    taken.add(page.lower())
    return page


def _row(name: str, path: Path, page: Path, song) -> str:
    motion = Motion.load(path)
    facts = evaluate_dances(path, song=song).facts()["rows"]  # the file may bring its own beats
    values = {row["name"]: row["value"] for row in facts}
    save_player(motion, page, song, metrics=False)
    cells = "".join(_number(values.get(metric)) for metric in SHOWN)
    label, link = html.escape(name), quote(page.name)
    return (
        f'<tr><td><a href="{link}">{label}</a><br>'
        f"{motion.people}, {motion.duration:.1f} s</td>"
        f'<td><a href="{link}"><img alt="{label}" src="{_strip(motion)}"></a></td>'
        f"{cells}</tr>"
    )


def _failure(name: str, why: str) -> str:
    wide = len(SHOWN) + 1
    return (
        f"<tr><td>{html.escape(name)}</td>"
        f'<td colspan="{wide}" class="why">no dance: {html.escape(why)}</td></tr>'
    )


def _number(value) -> str:
    if value is None:
        return '<td class="n">-</td>'
    return f'<td class="n" data-v="{value:.6g}">{value:.3g}</td>'


def _strip(motion: Motion) -> str:
    """A filmstrip as a data address."""
    return data_url(as_png(filmstrip_page(motion, count=4), dpi=60))


def _page(title: str, rows: list[str], made: Gallery, song) -> str:
    lost = len(made.failed)
    music = "" if song is None else f" to {html.escape(song.name)}"
    parts = {
        "TITLE": html.escape(title),
        "COUNT": f"{len(made.dances)} dances{music}"
        + (f", {lost} files that are none" if lost else ""),
        "HEADS": "".join(
            f"<th><button>{name}</button></th>" if name else "<th></th>"
            for name in ("dance", "", *SHOWN)
        ),
        "ROWS": "\n".join(rows),
    }
    text = (PAGE / "gallery.html").read_text(encoding="utf-8")
    return re.sub(r"\{\{(\w+)\}\}", lambda mark: parts[mark[1]], text)
