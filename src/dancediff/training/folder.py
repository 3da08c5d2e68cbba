"""The folder of a training: is it free, and what in it did trainings of other models leave?"""

import json
from collections.abc import Iterable
from pathlib import Path

from torch import nn

from dancediff.extensions.build import NETWORKS, paper_class
from dancediff.extensions.own_network import class_name
from dancediff.training.checkpoint import NAME, check_free
from dancediff.training.evaluator import forget


def check_out(
    out: Path,
    kind: type[nn.Module],
    trained: Iterable[Path],
    *,
    resume: bool | None,
    overwrite: bool | None,
) -> None:
    """Refuse to train a class where a training lies, unless it was said what shall become of it.

    ``trained``: the folders, ``out`` or some in it, in which this training puts its checkpoints. To
    go on (``resume``) is no answer to a training of another kind of model.

    Raises: ValueError naming the folder.
    """
    for folder in trained:
        check_free(folder, resume, overwrite)
    if overwrite:
        return
    how = "replace it (overwrite) or choose another folder"
    if others := _of_others(out, kind):
        text = f"{str(out)!r} holds a training of another kind of model, {str(others[0])!r}; "
        raise ValueError(f"{text}{how}")
    if not resume or (stored := _class_in(out / "model")) is None:
        return
    if stored != (name := class_name(kind)):
        text = f"{str(out / 'model')!r} is a {stored}, but the config trains a {name}; use its "
        raise ValueError(f"{text}config, {how}")


def clear_out(out: Path, kind: type[nn.Module]) -> None:
    """Before a training replaces that in ``out``, remove what it would not overwrite itself."""
    forget(out)
    for path in _of_others(out, kind):
        path.unlink()
        (path.parent / "losses.csv").unlink(missing_ok=True)
        forget(path.parent)


def _of_others(out: Path, kind: type[nn.Module]) -> list[Path]:
    """Checkpoints in a folder where no training of this class puts one, but those of others do."""
    every = {path for network, _ in NETWORKS.values() for path in _checkpoints(out, network)}
    return sorted(path for path in every - _checkpoints(out, kind) if path.exists())


def _checkpoints(out: Path, kind: type[nn.Module]) -> set[Path]:
    """Where a training of this class puts its checkpoints: in a folder for each stage, or in one.

    >>> sorted(path.parent.name for path in _checkpoints(Path("run"), NETWORKS["Lodge"][0]))
    ['fine_tune', 'global', 'local']
    """
    stages = getattr(paper_class(kind), "stages", None)
    return {out / NAME} if stages is None else {out / stage / NAME for stage in stages}


def _class_in(folder: Path) -> str | None:
    """The class that a model folder names; None where there is no such folder."""
    try:
        return json.loads((folder / "config.json").read_text(encoding="utf-8"))["class"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
