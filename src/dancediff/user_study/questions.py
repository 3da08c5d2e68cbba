"""What the papers asked the people who compared dances.

TCDiff++ asked for four criteria (figure 8) and Lodge which of two dances is more impressive
(section 4.2). Neither prints its questions; the wording is ours.
"""

from typing import NamedTuple


class Question(NamedTuple):
    """A question about two dances: its name in the scores, and its words on the page."""

    name: str
    text: str


QUESTIONS = {
    "tcdiffpp": (
        Question("motion realism", "Which moves more like real people?"),
        Question("music-motion correlation", "Which fits the music better?"),
        Question("formation aesthetics", "Which has the more beautiful formations?"),
        Question("harmony of dancers", "In which do the dancers dance together better?"),
    ),
    "lodge": (Question("impression", "Which dance is more impressive?"),),
}


def questions_for(paper: str | None, dancers: int) -> tuple[Question, ...]:
    """The questions of a paper; by default Lodge's for soloists, TCDiff++'s for groups.

    Raises: ValueError when there is no such paper, or TCDiff++'s are asked about soloists, who have
    no formation.

    >>> [question.name for question in questions_for(None, dancers=1)]
    ['impression']
    """
    paper = paper or ("lodge" if dancers == 1 else "tcdiffpp")
    if paper not in QUESTIONS:
        raise ValueError(f"questions={paper!r} is not one of {', '.join(QUESTIONS)}")
    if paper == "tcdiffpp" and dancers == 1:
        raise ValueError(
            "questions='tcdiffpp' ask about formations, and there are soloists; choose 'lodge'"
        )
    return QUESTIONS[paper]
