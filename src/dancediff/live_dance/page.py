"""The page of a live session: the HTML player, with knobs, fed by a websocket.

Read first: `dancediff.viz.player` · ``assets/live/live.js``.
"""

import json
from itertools import permutations

from dancediff.axes import FPS
from dancediff.data.choreographer.formations import formation_names
from dancediff.extensions.energy_condition import has_energy_condition
from dancediff.extensions.genre_condition import genres_of
from dancediff.extensions.group_relations import places
from dancediff.motion.motion import Motion
from dancediff.motion.skeleton import SMPL24
from dancediff.viz.palette import dancer_color
from dancediff.viz.player import PAGE, packed, shared_facts

FOLDER = PAGE.parent / "live"
SIDE = 12  # metres of floor that are shown


def live_page(session, host: str) -> str:
    """The page as HTML; ``host`` is what it may speak to, such as "127.0.0.1:8765"."""
    n, frames = session.dancers, session.stream.request.frames
    people = "1 dancer" if n == 1 else f"{n} dancers"
    title = f"{session.song.name} · {people} · live"
    facts = shared_facts(SMPL24, title, frames=frames, fps=float(FPS))
    facts |= {"song": None if session.listens else "song.wav", "centre": [0.0, 0.0], "side": SIDE}
    facts["live"] = {"knobs": knobs(session), "listens": session.listens}
    colors = [dancer_color(k) for k in range(n)]
    facts["panes"] = [{"title": "", "metrics": [], "colors": colors}]
    text = json.dumps(facts, separators=(",", ":")).replace("<", "\\u003c")  # no tag can begin
    page = (PAGE / "page.html").read_text(encoding="utf-8")
    code = (PAGE / "player.min.js").read_text(encoding="utf-8")
    more = (FOLDER / "live.html").read_text(encoding="utf-8")
    script = (FOLDER / "live.js").read_text(encoding="utf-8")
    for mark, content in (
        ("media-src data:", f"media-src 'self'; connect-src 'self' ws://{host}"),
        ("</nav>", f"</nav>\n{more}"),
        ("</html>", f"<script>{script}</script>\n</html>"),
        ("{{PLAYER}}", code),
        ("{{DATA}}", text),
    ):
        before, after = page.split(mark)
        page = before + content + after
    return page


def knobs(session) -> dict:
    """What can be changed while this model dances: for each knob its (text, value) pairs."""
    model, n = session.pipeline.model, session.stream.request.dancers
    found: dict[str, list[tuple]] = {}
    if has_energy_condition(model):
        found["energy"] = []
    if genres := genres_of(model):
        found["genre"] = [(name, name) for name in genres]
    if 1 < n <= 4:
        orders = ((" ".join(map(str, order)), order) for order in permutations(range(n)))
        found["swap"] = [("any", None), *orders]
    if n > 1 and session.stream.can_form:
        found["formation"] = [
            ("free", None),
            *((name, places(n, name).tolist()) for name in formation_names(n)),
        ]
    return found


def piece_facts(start: float, motion: Motion) -> dict:
    """A piece as the page takes it."""
    return {"start": round(start * FPS), "frames": motion.num_frames} | packed(motion)
