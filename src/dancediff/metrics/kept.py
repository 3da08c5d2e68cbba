"""Measurements kept in a folder, so that an evaluation which was stopped goes on.

Read first: `dancediff.metrics.measure`.

A file's name is a hash of all that a measurement follows from: the dance's bytes, beats, window,
metrics of the user's own, and the code that measures. So what changed is measured anew.
"""

import json
from pathlib import Path

import numpy as np

from dancediff.atomic import write_text
from dancediff.data.cache import code_digest, content_key
from dancediff.metrics.drift import Drift
from dancediff.metrics.measure import Measured
from dancediff.own import own_digests


def kept_path(folder: Path, dance: Path, *facts, metrics: tuple[str, ...] = ()) -> Path:
    """Where the measurement of a file is kept, if it was made; ``facts`` are its options.

    Raises: OSError when the dance cannot be read.
    """
    code = code_digest(("motion", "metrics", "io", "export", "data"))
    names = (dance.parent.name, dance.name)  # what the dance is called
    own = own_digests(metrics)
    return folder / f"{content_key(code, names, dance.read_bytes(), *facts, own)}.json"


def read_kept(path: Path) -> Measured | None:
    """What is kept there; None where nothing is, or what is no whole measurement.

    >>> read_kept(Path("nowhere.json")) is None
    True
    """
    try:
        facts = json.loads(path.read_text(encoding="utf-8"))
        rows = {name: [_array(one) for one in many] for name, many in facts["rows"].items()}
        numbers = {
            name: [tuple(one) if isinstance(one, list) else one for one in many]
            for name, many in facts["numbers"].items()
        }
        if (drift := facts["drift"]) is not None:
            drift = Drift(_array(drift["values"]), _array(drift["seconds"]), tuple(drift["names"]))
        return Measured(**facts | {"rows": rows, "numbers": numbers, "drift": drift})
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return None


def keep(path: Path, found: Measured) -> None:
    """Write a measurement, whole or not at all; read back, it gives the same table."""
    facts = dict(vars(found))
    facts["rows"] = {name: [_plain(one) for one in many] for name, many in found.rows.items()}
    if found.drift is not None:
        drift = found.drift
        facts["drift"] = {"values": _plain(drift.values), "seconds": _plain(drift.seconds)}
        facts["drift"]["names"] = drift.names
    write_text(path, json.dumps(facts))


def _plain(array: np.ndarray) -> dict:
    return {"kind": str(array.dtype), "values": array.tolist()}


def _array(facts: dict) -> np.ndarray:
    return np.array(facts["values"], dtype=np.dtype(facts["kind"]))
