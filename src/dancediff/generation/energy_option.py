r"""Energy that is asked for: the song's own, more or less of it, or another course.

Symbols (axes: f frames of the song)
    M   music features, raw   (f, m)
"""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from torch import Tensor

ANY = "any"  # none in particular; a model learns it from windows without their energy
Points = tuple[tuple[float, float], ...]  # (seconds, value)
Energy = float | str | Points | tuple[float, ...]


def energy_of(asked) -> Energy:
    """A request in its one form: a factor, "any", points, or a value for every frame.

    Points and factors may be written as text, as on the command line.

    Raises: ValueError naming what is allowed.

    >>> energy_of("0.5"), energy_of([(0, 0.2), (8, 1)]), energy_of("0:0.2, 8:1")
    (0.5, ((0.0, 0.2), (8.0, 1.0)), ((0.0, 0.2), (8.0, 1.0)))
    """
    import numpy as np

    if isinstance(asked, str):
        if asked == ANY:
            return ANY
        asked = [part.split(":") for part in asked.split(",")] if ":" in asked else asked
    try:
        values = np.asarray(asked, dtype=float)
    except (TypeError, ValueError):
        values = np.empty((0, 0, 0))
    pairs = values.ndim == 2 and values.shape[1] == 2 and len(values) > 0
    if not pairs and (values.ndim > 1 or not values.size):
        raise ValueError(
            f"energy={asked!r} must be a number that the song's own is multiplied with, points "
            "(seconds, value), or a value for every frame"
        )
    if values.ndim == 0:
        if not 0 <= values < np.inf:
            raise ValueError(f"energy={asked!r} must be a number of at least 0")
        return float(values)
    levels = values[:, 1] if pairs else values
    if not ((levels >= 0) & (levels <= 1)).all():
        low, high = levels.min(), levels.max()
        raise ValueError(f"energy has values of {low:g} to {high:g}; they must lie in 0 ... 1")
    if not pairs:
        return tuple(values.tolist())
    if not (np.isfinite(values[:, 0]).all() and (np.diff(values[:, 0]) > 0).all()):
        raise ValueError(f"energy={asked!r} must have its points in the order of their seconds")
    return tuple((float(second), float(value)) for second, value in values)


def resolved_energy(asked: Energy | None, usual: Energy, model, frames: int) -> Energy | None:
    """What a model gets: what is asked for, else what is usual; None if it does not listen to it.

    Raises: ValueError for such a model that is asked for more, and a curve of another length.
    """
    from dancediff.extensions.energy_condition import has_energy_condition

    if not has_energy_condition(model):
        if asked in (None, ANY):
            return None
        shown = asked if isinstance(asked, float) else "[...]"
        raise ValueError(
            f"energy={shown} needs a model that listens to energy; leave it out, or train one with "
            "the extension 'energy_condition'"
        )
    asked = usual if asked is None else asked
    if isinstance(asked, tuple) and is_curve(asked) and len(asked) != frames:
        raise ValueError(
            f"energy has {len(asked)} values, the dance {frames} frames; give one for each, or "
            "points (seconds, value)"
        )
    return asked


def is_curve(asked: Energy | None) -> bool:
    """Is it a value for every frame?"""
    return isinstance(asked, tuple) and isinstance(asked[0], float)


def energy_for(asked: Energy, M: "Tensor") -> "Tensor":
    """The energy of a resolved request along the whole song; nan where it is unknown.

    Behind the last point, and behind a dance that is shorter than its song, the last value goes on.

    Shapes: M (f, m) -> (f,).

    >>> import torch
    >>> energy_for(((0.0, 0.25), (0.1, 1.0)), torch.zeros(6, 35)).tolist()
    [0.25, 0.5, 0.75, 1.0, 1.0, 1.0]
    """
    import numpy as np
    import torch

    from dancediff.axes import FPS
    from dancediff.music.energy import energy_curve

    if isinstance(asked, str):
        return torch.full((len(M),), torch.nan)
    if isinstance(asked, float):
        return (asked * energy_curve(M)).clamp(0, 1)
    pairs = [(k / FPS, value) for k, value in enumerate(asked)] if is_curve(asked) else asked
    seconds, values = np.array(pairs).T
    return torch.tensor(np.interp(np.arange(len(M)) / FPS, seconds, values), dtype=torch.float32)
