"""`dancediff.study`: from systems to a page that people answer, and a key to their answers.

Read first: `dancediff.user_study.pairs` · `dancediff.user_study.blinding` ·
`dancediff.user_study.scores`.
"""

import hashlib
import json
import secrets
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dancediff.atomic import atomic_write
from dancediff.user_study.blinding import blind
from dancediff.user_study.page import study_page
from dancediff.user_study.pairs import Pair, pairs_of, songs_named
from dancediff.user_study.questions import Question, questions_for


@dataclass(frozen=True)
class Study:
    """What `study` wrote: the page to hand out, the key to keep, and how much is asked."""

    page: Path
    key: Path
    pairs: int
    questions: tuple[str, ...]


def study(
    *systems,
    out="study.html",
    songs=(),
    seconds: float | None = None,
    dancers: int | None = None,
    questions: str | None = None,
    seed: int | None = None,
    progress: bool = False,
) -> Study:
    """Write a page on which people compare dances blindly, as in both papers' user studies.

    The first of ``systems`` is compared with each of the others, song by song. A system is a folder
    of dances, whose songs are told by what the dances say of themselves or by their names, or a
    model, which dances to all songs by its defaults.

    - ``out``: the page; beside it the key, OUT.key.json, without which nothing can be scored.
    - ``songs``: the sound: files, folders, `Music`, or "packaged".
    - ``seconds``: at most so much of each dance; ``dancers``: how many a model lets dance.
    - ``questions``: "tcdiffpp" for its four, "lodge" for its one; default: for groups the four.
    - ``seed``: of order and sides; by default a new one, since a known one would be a second key.
    - ``progress``: show bars while models dance.

    Source: TCDiff++ figure 8; Lodge section 4.2.

    Raises: ValueError naming what does not fit: see `dancediff.user_study.pairs.pairs_of`, and when
    the page has a key already; OSError when a file cannot be written.

    >>> import tempfile
    >>> import dancediff as dd
    >>> song = dd.packaged_song()
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     for name, steps in (("few", 2), ("more", 4)):
    ...         dance = dd.load("tcdiffpp").generate(song, dancers=2, seconds=2, steps=steps)
    ...         Path(folder, name).mkdir()
    ...         _ = dance.save(f"{folder}/{name}/dance.npz")
    ...     made = study(f"{folder}/few", f"{folder}/more", out=f"{folder}/a.html", songs=song)
    ...     made.pairs, made.key.name, len(made.questions)
    (1, 'a.key.json', 4)
    """
    out = Path(out)
    if key_of(out).exists():  # a new key would leave the answers to the first page without one
        raise ValueError(
            f"out={str(out)!r}: its key {str(key_of(out))!r} is there already, and answers to that "
            "page need it; name another page, or remove the key"
        )
    seed = secrets.randbits(32) if seed is None else seed
    pairs = pairs_of(
        systems, songs_named(songs), seconds=seconds, dancers=dancers, progress=progress
    )
    asked = questions_for(questions, min(pair.dances[0].num_dancers for pair in pairs))
    generator = np.random.default_rng([seed, _number_of(pairs, asked)])
    id = generator.bytes(6).hex()
    shown = blind(pairs, generator)
    page = study_page(id, shown, asked)
    names = tuple(question.name for question in asked)
    key = {"study": id, "seed": seed, "questions": names}
    key["pairs"] = {one.id: one.key() | {"first": one.pair.systems[0]} for one in shown}
    made = Study(out, key_of(out), len(pairs), names)
    out.parent.mkdir(parents=True, exist_ok=True)
    for path, text in ((made.key, json.dumps(key, indent=1) + "\n"), (made.page, page)):
        with atomic_write(path) as part:
            part.write_text(text, encoding="utf-8")
    return made


def _number_of(pairs: list[Pair], asked: Sequence[Question]) -> int:
    """A number that says what is compared and asked: another study has other ids by one seed."""
    facts = [[*pair.systems, pair.song.name] for pair in pairs], [one.name for one in asked]
    content = hashlib.sha256(json.dumps(facts).encode())
    for dance in (dance for pair in pairs for dance in pair.dances):
        content.update(dance.pose.numpy().tobytes() + dance.root.numpy().tobytes())
    return int.from_bytes(content.digest()[:8], "big")


def key_of(page: Path) -> Path:
    """Where the key of a page lies.

    >>> key_of(Path("study.html")).name
    'study.key.json'
    """
    return page.with_suffix(".key.json")
