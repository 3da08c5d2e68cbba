"""Run our own JavaScript in a notebook's page, without an extension and without the network."""

import json
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "assets" / "stage"


def in_page(p3, script: str, facts: dict):
    """Hand a file of ``assets/stage``, a function of (manager, facts), to the page.

    pythreejs runs it for us: the function of a `ParametricGeometry` is a string of JavaScript that
    it evaluates where ``this`` is the widget's model, which knows all other models of the notebook
    by their ids. Returns that widget, which must be kept for as long as the script is wanted.
    """
    code = (FOLDER / script).read_text(encoding="utf-8").strip()
    # pythreejs evaluates it twice, hence ??=; the second function is the surface it asks for
    return p3.ParametricGeometry(
        func=f"(this.ran ??= ({code})(this.widget_manager, {json.dumps(facts)}), "
        "(u, v, point) => point.set(u, v, 0))"
    )
