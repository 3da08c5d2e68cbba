r"""Where a group stands, and how it gets from one formation to the next without a collision.

Symbols (axes: n dancers · f steps along the way)
    slots   places on the stage floor, metres      (n, 2)   x lateral, z depth
    paths   from one place to the next, metres     (n, f, 2)
"""

import tomllib
from pathlib import Path

import numpy as np

MIN_DISTANCE = 0.75  # metres between two roots on their way, before steps and sway are added
FAR = 3.0  # metres; nobody changes places over a longer way
_EASE = 0.4  # how much slower a way begins and ends than it would at an even speed

_FORMATIONS = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))


def formation_names(n: int) -> list[str]:
    """Names of the formations for n dancers.

    >>> formation_names(2)
    ['line', 'diagonal', 'counter-diagonal']
    """
    return list(_FORMATIONS[str(n)])


def slots(n: int, name: str) -> np.ndarray:
    """The places of a formation, left to right, (n, 2) metres.

    >>> slots(3, "line")[:, 0].tolist()
    [-1.3, 0.0, 1.3]
    """
    return np.array(_FORMATIONS[str(n)][name], dtype=np.float64)


def min_distance(paths: np.ndarray) -> np.ndarray:
    """Smallest distance between any two dancers at any time; paths (..., n, f, 2) -> metres (...).

    >>> min_distance(np.zeros((1, 5, 2))).item()
    inf
    """
    i, j = np.triu_indices(paths.shape[-3], 1)
    gap = paths[..., i, :, :] - paths[..., j, :, :]
    return np.sqrt((gap * gap).sum(-1).min((-2, -1), initial=np.inf))


def curved_paths(start: np.ndarray, stop: np.ndarray, bulge: np.ndarray, steps: int) -> np.ndarray:
    r"""Straight lines with a sideways bow, so that two who change places can pass.

    $$p_i(u) = (1-u)\,a_i + u\,b_i + \beta_i \sin(\pi u)\, d_i^\perp,\quad
      u = \tau - 0.4\,\tfrac{\sin 2\pi\tau}{2\pi}$$

    tau is the share of the time that is over.
    Shapes: start, stop (n, 2), bulge (..., n) metres -> (..., n, steps, 2).
    """
    tau = np.linspace(0, 1, steps)[None, :, None]
    u = tau - _EASE * np.sin(2 * np.pi * tau) / (2 * np.pi)
    way = stop - start
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    square = np.stack([-way[:, 1], way[:, 0]], -1) / np.maximum(length, 1e-9)
    bow = bulge[..., None, None] * np.sin(np.pi * u) * square[:, None]
    return start[:, None] * (1 - u) + stop[:, None] * u + bow


def plan_transition(start: np.ndarray, target: np.ndarray, rng: np.random.Generator, *, order: str):
    """Choose who goes to which slot, and bows that keep everybody apart.

    ``order``: "keep", everybody keeps their rank from left to right; "swap", two dancers exchange
    theirs; "any", every other order is as likely. Where no safe way is found, ranks are kept.

    Shapes: start (n, 2) by dancer, target (n, 2) by slot -> stop (n, 2) by dancer, bulge (n,),
    whether ranks changed. If no way is safe at all, everybody stays.
    """
    n = len(start)
    rank = np.argsort(np.argsort(start[:, 0]))
    for _ in range(0 if order == "keep" or n < 2 else 12):
        new = _exchanged(rank, rng) if order == "swap" else rng.permutation(n)
        too_far = np.linalg.norm(target[new] - start, axis=-1).max() > FAR
        if too_far or np.array_equal(new, rank):
            continue
        bulge = _safe_bows(start, target[new], rng.choice([-0.8, -0.45, 0.0, 0.45, 0.8], (40, n)))
        if bulge is not None:
            return target[new], bulge, True
    bulge = _safe_bows(start, target[rank], rng.choice([-0.4, 0.0, 0.0, 0.4], (60, n)))
    if bulge is not None:
        return target[rank], bulge, False
    return start.copy(), np.zeros(n), False


def _exchanged(rank: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    new = rank.copy()
    i, j = rng.choice(len(rank), 2, replace=False)
    new[i], new[j] = rank[j], rank[i]
    return new


def _safe_bows(start: np.ndarray, stop: np.ndarray, bows: np.ndarray) -> np.ndarray | None:
    """The first of several choices of bows, (k, n), with which nobody meets anybody."""
    safe = min_distance(curved_paths(start, stop, bows, 24)) > MIN_DISTANCE
    return bows[safe.argmax()] if safe.any() else None
