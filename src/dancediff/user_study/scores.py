"""What the answers to a user study say: win rates with intervals, and whether raters agree.

Read first: `dancediff.metrics.preference` · `dancediff.metrics.agreement`.
"""

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

from dancediff.metrics.agreement import krippendorff_alpha
from dancediff.metrics.preference import WinRate, win_rate
from dancediff.user_study.blinding import LEFT, RIGHT


class Vote(NamedTuple):
    """One answer, with what the key says about it."""

    rater: str
    pair: str
    question: str
    side: str
    winner: str
    first: str  # the system that is compared with the others
    against: str


@dataclass(frozen=True)
class StudyScore:
    """How often the first system was preferred to another, by one question's answers.

    ``alpha``: Krippendorff's, of which dance of a pair raters chose; None where it is not defined,
    as with one rater.
    """

    question: str
    first: str
    against: str
    rate: WinRate
    alpha: float | None


@dataclass(frozen=True)
class StudyScores:
    """All scores of a study; ``str`` is a table."""

    raters: int
    scores: list[StudyScore]
    left: float  # the share of votes for the dance on the left

    def facts(self) -> dict:
        """The same as plain JSON."""
        rows = [asdict(score) | {"rate": score.rate._asdict()} for score in self.scores]
        return {"raters": self.raters, "left": self.left, "scores": rows}

    def __str__(self) -> str:
        """A line a question and opponent."""
        names = [f"{score.first} over {score.against}" for score in self.scores]
        wide = max(map(len, ["preferred", *names]))
        asked = max(map(len, ["question", *(score.question for score in self.scores)]))
        lines = [
            f"{'preferred':{wide}}  {'question':{asked}}  win rate  95 % interval  votes  alpha"
        ]
        for name, score in zip(names, self.scores, strict=True):
            rate, alpha = score.rate, "-" if score.alpha is None else f"{score.alpha:.2f}"
            interval = f"[{rate.low:.2f}, {rate.high:.2f}]"
            lines.append(
                f"{name:{wide}}  {score.question:{asked}}  {rate.value:8.2f}  {interval:>13}  "
                f"{rate.votes:5}  {alpha:>5}"
            )
        lines += ["", f"{self.raters} raters; the left dance got {self.left:.0%} of all votes"]
        return "\n".join(lines)


def score_study(answers: Sequence, key=None) -> StudyScores:
    """StudyScore files of answers with the key of their study.

    ``key``: its file; default: the one among ``answers`` whose name ends in .key.json. A file that
    is handed in twice counts once.

    Alpha is of the choice between left and right. The sides are drawn, so that raters who choose at
    random differ on half of the pairs, however often the first system wins.

    Raises: ValueError naming a file that cannot be read, is of another study, or holds another
    person's answers under one token; also when there is no key or no vote.
    """
    paths = [Path(path) for path in answers]
    keys = [path for path in paths if path.name.endswith(".key.json")]
    found = [Path(key)] if key is not None else keys
    if len(found) != 1:
        raise ValueError(
            f"{len(found)} keys are given; scoring needs the one .key.json that was written with "
            "the page"
        )
    secret = _read(found[0], ("study", "questions", "pairs"))
    votes = _votes([path for path in paths if path not in keys], secret)
    if not votes:
        raise ValueError("there are no votes; give files of answers that raters downloaded")
    return StudyScores(
        raters=len({vote.rater for vote in votes}),
        scores=_scores(votes, secret["questions"]),
        left=sum(vote.side == LEFT for vote in votes) / len(votes),
    )


def _scores(votes: list[Vote], questions: list[str]) -> list[StudyScore]:
    """One for each opponent and question that has votes."""
    scores = []
    for first, against in sorted({(vote.first, vote.against) for vote in votes}):
        for question in questions:
            here = [v for v in votes if (v.against, v.question) == (against, question)]
            if here:
                wins = [vote.winner == first for vote in here]
                rate = win_rate(wins, [v.pair for v in here], [v.rater for v in here])
                scores.append(StudyScore(question, first, against, rate, _alpha(here)))
    return scores


def _alpha(votes: list[Vote]) -> float | None:
    pairs: dict[str, list[str]] = {}
    for vote in votes:
        pairs.setdefault(vote.pair, []).append(vote.side)
    counts = [[sides.count(LEFT), sides.count(RIGHT)] for sides in pairs.values()]
    alpha = krippendorff_alpha(counts)
    return None if math.isnan(alpha) else alpha


def _votes(paths: list[Path], secret: dict) -> list[Vote]:
    """All votes of all files, each rater's once."""
    seen: dict[str, tuple[Path, list]] = {}
    for path in paths:
        file = _read(path, ("study", "token", "answers"))
        if not isinstance(file["token"], str) or not isinstance(file["answers"], list):
            raise ValueError(f"{str(path)!r} holds no answers of a rater; take it as downloaded")
        if file["study"] != secret["study"]:
            raise ValueError(
                f"{str(path)!r} answers study {file['study']!r}, the key is of "
                f"{secret['study']!r}; give the answers and the key of one page"
            )
        before = seen.setdefault(file["token"], (path, file["answers"]))
        if before[1] != file["answers"]:
            raise ValueError(
                f"{str(before[0])!r} and {str(path)!r} are of one rater and differ; keep the one "
                "that counts"
            )
    votes: dict[tuple[str, str, str], Vote] = {}
    for token, (path, answers) in seen.items():
        for answer in answers:
            vote = _vote(token, answer, secret, path)
            if votes.setdefault((token, vote.pair, vote.question), vote) != vote:
                raise ValueError(
                    f"{str(path)!r} answers {vote.question!r} of pair {vote.pair!r} twice, and "
                    "differently; take the file as downloaded"
                )
    return list(votes.values())


def _vote(token: str, answer: dict, secret: dict, path: Path) -> Vote:
    try:
        known = secret["pairs"][answer["pair"]]
        systems = {side: known[side] for side in (LEFT, RIGHT)}
        winner, question = systems[answer["choice"]], answer["question"]
        if question not in secret["questions"]:
            raise KeyError(question)
    except (KeyError, TypeError) as err:
        raise ValueError(
            f"{str(path)!r}: answer {answer!r} is none to this study ({err}); download it again"
        ) from err
    first = known["first"]
    against = next(name for name in systems.values() if name != first)
    return Vote(token, answer["pair"], question, answer["choice"], winner, first, against)


def _read(path: Path, names: tuple[str, ...]) -> dict:
    try:
        file = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ValueError(f"{str(path)!r} does not exist; name a file of this study") from None
    except ValueError as err:  # no UTF-8, or no JSON
        raise ValueError(f"{str(path)!r} is no JSON ({err}); take the file as downloaded") from err
    missing = [name for name in names if not isinstance(file, dict) or name not in file]
    if missing:
        raise ValueError(f"{str(path)!r} has no {missing[0]!r}; take the file as it was written")
    return file
