"""What a benchmark has made stays in a folder and is not made again: of one model, in one way."""

import json
from hashlib import sha256
from pathlib import Path

from dancediff.atomic import write_text
from dancediff.bench.scores import loaded


def digest_of(model: str | Path) -> str:
    """Changes with the weights of a model."""
    weights = loaded(model).model.state_dict()
    parts = (value.cpu().contiguous().numpy().tobytes() for value in weights.values())
    return sha256(b"".join(parts)).hexdigest()[:8]


def only_one_way(folder: Path, how: dict) -> None:
    """Make a folder, and refuse to mix there what was made in different ways.

    Raises: SystemExit where the folder holds something made otherwise, or nobody knows how.
    """
    path, text = folder / "how.json", json.dumps(how, indent=1, default=str)
    there = path.read_text(encoding="utf-8") if path.exists() else None
    if there != text and folder.exists() and any(folder.iterdir()):
        raise SystemExit(
            f"{str(folder)!r} holds dances made with other options ({path.name} says which); "
            "give another --out"
        )
    folder.mkdir(parents=True, exist_ok=True)
    write_text(path, text)
