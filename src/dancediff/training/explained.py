"""Every key of a training config with its value, its default and a line on what it does.

Read first: `dancediff.training.config`.

The lines are the comments beside the fields of the dataclasses, so what is read here is what
stands in the source.
"""

import inspect
import re
from collections.abc import Iterator
from dataclasses import MISSING, fields
from textwrap import wrap

from dancediff.extensions.build import paper_class
from dancediff.extensions.registry import REGISTRY
from dancediff.training import autoregressive, lodge, run
from dancediff.training.tables import read_training, types_of

WIDTH = 100
_FIELD = re.compile(r"^    (\w+): [^#\n]*#\s*(.+)$", re.MULTILINE)


def explain_config(path) -> str:
    """The tables of a config as text: what it sets, and what it could.

    Raises: ValueError for a config that does not fit, as `dancediff train` does.
    """
    config, source = read_training(path), repr(str(path))
    if lodge.is_lodge(config):
        lodge.check_lodge_tables(config, source)
        tables, family = lodge.TABLES, "lodge"
    elif autoregressive.is_autoregressive(config):
        autoregressive.check_autoregressive_tables(config, source)
        tables, family = autoregressive.known_tables(config), config["model"]["class"].lower()
    else:
        run.check_tables(config, source)
        model_class, sizes = run.network_classes(config["model"].get("class", "TCDiffPP"))
        tables = run.tables_of(model_class, sizes)
        family = paper_class(model_class).__name__.lower()
    lines = [f"{path} sets what has a star; a value in brackets is what it would be without."]
    for table, kind in tables.items():
        lines += ["", f"[{table}]", *_table(table, kind, config, family)]
    return "\n".join(lines)


def notes_of(kind: type) -> dict[str, str]:
    """The comment beside each field of a dataclass and of those it derives from.

    >>> from dancediff.training.config import TrainConfig
    >>> notes_of(TrainConfig)["lr"]
    'highest learning rate'
    """
    notes: dict[str, str] = {}
    for base in reversed(kind.__mro__[:-1]):
        notes |= dict(_FIELD.findall(inspect.getsource(base)))
    return {one.name: notes[one.name] for one in fields(kind) if one.name in notes}


def defaults_of(kind: type) -> dict[str, object]:
    """What each plain field of a dataclass is where a config leaves it out."""
    return {
        one.name: None if one.default is MISSING else one.default
        for one in fields(kind)
        if one.name in types_of(kind)
    }


def _table(table: str, kind: type, config: dict, family: str) -> Iterator[str]:
    defaults, given = defaults_of(kind), config.get(table, {})
    if table == "discriminator" and table not in config:
        yield "  without this table there is none"
    if table == "model":
        yield from _model(given, family)
        defaults.pop("extensions", None)  # Lodge has nothing else there
    stage = table.removeprefix("train_").removeprefix("weights_")
    if table.startswith("weights_"):
        weights = lodge.STAGES[stage]()
        defaults = {name: getattr(weights, name) for name in defaults}
    elif stage != table:
        yield f"  any key of [train], where the {stage} stage differs"
        defaults = {name: config["train"].get(name, defaults[name]) for name in given}
    notes = notes_of(kind)
    for name, usual in defaults.items():
        yield from _entry(
            name, given.get(name, usual), usual, notes.get(name, ""), starred=name in given
        )


def _model(given: dict, family: str) -> Iterator[str]:
    chosen, kind = given.get("extensions", []), given.get("class", "TCDiffPP")
    known = ", ".join([*run.MODELS, *autoregressive.MODELS])
    known = f"one of {known}, Lodge, or 'module:Class' of your own"
    yield from _entry("class", kind, "TCDiffPP", known, starred="class" in given)
    known_here = [
        one for one in REGISTRY.values() if one.kind == "network" and family in one.models
    ]
    if known_here:
        note = "what is added, of these:"
        yield from _entry("extensions", chosen, [], note, starred="extensions" in given)
    for one in known_here:
        yield f"    {'*' if one.name in chosen else ' '} {one.name:<22} {one.summary}"
    if "genre_condition" in {one.name for one in known_here}:
        genres, note = given.get("genres", []), "for genre_condition; without: all"
        yield from _entry("genres", genres, [], note, starred="genres" in given)


def _entry(name: str, value, usual, note: str, *, starred: bool) -> list[str]:
    was = f" [{_text(usual)}]" if _text(usual) not in (_text(value), "[]") else ""
    head = f"{'*' if starred else ' '} {name} = {_text(value)}{was}"
    indent = " " * 36 + "# "
    if len(head) > 60:
        return [*wrap(head, WIDTH, subsequent_indent=" " * 6), indent + note]
    return wrap(f"{head:<34}  # {note}", WIDTH, subsequent_indent=indent)


def _text(value) -> str:
    """As TOML writes it.

    >>> _text(True), _text("adamw"), _text(("a",)), _text(0.001)
    ('true', '"adamw"', '["a"]', '0.001')
    """
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"'
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_text, value))}]"
    return "none" if value is None else f"{value:g}" if isinstance(value, float) else str(value)
