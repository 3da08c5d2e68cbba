"""`dancediff study`: a blind comparison by people, as both papers made one."""

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import tyro

from dancediff.cli.files import check_folder, tell


@dataclass
class Study:
    """Make a page on which people compare dances blindly, or score their answers.

    A page holds pairs of dances in random order, with sound. Raters vote by keys and download a
    file of answers; --score reads them together with the key, which stays with you.
    """

    systems: tyro.conf.Positional[tuple[str, ...]] = ()
    """Folders of dances or models (a packaged name, or a model folder). The first is compared with
    each of the others, song by song."""
    songs: tuple[str, ...] = ()
    """Sound files, folders of them, or 'packaged': what models dance to, and what is heard."""
    out: Path = Path("study.html")
    """The page. Its key is written beside it, as study.key.json: do not hand it out."""
    seconds: float | None = None
    """At most so much of each dance; default: all that both have."""
    dancers: int | None = None
    """How many a model lets dance; default: its own."""
    questions: Literal["tcdiffpp", "lodge"] | None = None
    """TCDiff++'s four questions or Lodge's one; default: TCDiff++'s for groups."""
    seed: int | None = None
    """Of order and sides; default: a new one, which the key names."""
    score: tuple[Path, ...] = ()
    """Files of answers to score; the key may be among them."""
    key: Path | None = None
    """The key; default: the .key.json among the files, else the one beside OUT."""
    json: bool = False
    """Print one line of JSON instead of text."""

    def run(self) -> None:
        """Make the page, or score."""
        if self.score and self.systems:
            raise ValueError("--score reads answers and makes no page; leave the systems out")
        if self.score:
            self._score()
            return
        from dancediff.user_study.make import study

        if self.out.is_dir():
            raise ValueError(f"--out {str(self.out)!r} is a folder; name an .html file in it")
        check_folder(self.out.parent)
        made = study(
            *self.systems,
            out=self.out,
            songs=self.songs,
            seconds=self.seconds,
            dancers=self.dancers,
            questions=self.questions,
            seed=self.seed,
            progress=not self.json,
        )
        facts = {"page": made.page, "key": made.key, "pairs": made.pairs}
        lines = [
            f"page: {made.page} (pairs: {made.pairs}, questions on each: {len(made.questions)})",
            f"key, not to be handed out: {made.key}",
        ]
        tell(self.json, facts | {"questions": made.questions}, lines)

    def _score(self) -> None:
        from dancediff.user_study.make import key_of
        from dancediff.user_study.scores import score_study

        key = self.key
        if key is None and not any(path.name.endswith(".key.json") for path in self.score):
            key = key_of(self.out)
        scores = score_study(self.score, key)
        tell(self.json, scores.facts(), [str(scores)])
