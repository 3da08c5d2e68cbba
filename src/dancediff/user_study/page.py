"""The page of a user study: one file with all dances and songs, which asks for nothing.

Read first: `dancediff.viz.player`, whose page shows each pair · ``assets/study/study.js``.
"""

from importlib.resources import files

from dancediff.user_study.blinding import BlindPair
from dancediff.user_study.questions import Question
from dancediff.viz.player import as_data, player_facts, player_page

LEAST = 5  # seconds of a pair that are watched before it can be judged, if it is as long


def study_page(id: str, shown: list[BlindPair], questions: tuple[Question, ...]) -> str:
    """The page as HTML. Of a pair it holds the id, the dances and the song; no system's name.

    Raises: ValueError as `dancediff.viz.player.save_player`.
    """
    shortest = min(one.dances[0].duration for one in shown)
    study = {
        "id": id,
        "pairs": [one.id for one in shown],
        "questions": [question._asdict() for question in questions],
        "least": min(LEAST, int(shortest)),
    }
    folder = files("dancediff") / "assets" / "study"
    page = (folder / "study.html").read_text(encoding="utf-8")
    for mark, content in (  # the last first: what is filled in may hold a mark's letters
        ("{{SCRIPT}}", (folder / "study.js").read_text(encoding="utf-8")),
        ("{{PAIRS}}", "\n".join(map(_data_of, shown))),
        ("{{PLAYER}}", as_data(player_page())),
        ("{{STUDY}}", as_data(study)),
    ):
        before, after = page.split(mark, 1)
        page = before + content + after
    return page


def _data_of(one: BlindPair) -> str:
    facts = player_facts(list(one.dances), one.pair.song, titles=("Left", "Right"), metrics=False)
    return f'<script type="application/json" id="pair-{one.id}">{as_data(facts)}</script>'
