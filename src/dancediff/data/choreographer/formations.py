r"""Where a group stands, and how it gets from one formation to the next without a collision.

Symbols (axes: n dancers · f steps along the way)
    slots   places on the stage floor, metres      (n, 2)   x lateral, z depth
    paths   from one place to the next, metres     (n, f, 2)
"""

import itertools

import numpy as np

MIN_DISTANCE = 0.75  # metres between two roots on their way, before steps and sway are added

# Slots are listed left to right. No two share an x, so that "left to right" is always defined.
_FORMATIONS = {
    1: {"centre": [(0, 0)], "left": [(-0.7, 0.2)], "right": [(0.7, -0.2)]},
    2: {
        "line": [(-0.7, 0), (0.7, 0)],
        "diagonal": [(-0.65, 0.5), (0.65, -0.5)],
        "counter-diagonal": [(-0.65, -0.5), (0.65, 0.5)],
    },
    3: {
        "line": [(-1.3, 0), (0, 0), (1.3, 0)],
        "triangle": [(-1.0, -0.5), (0, 0.6), (1.0, -0.5)],
        "V": [(-1.0, 0.5), (0, -0.6), (1.0, 0.5)],
        "diagonal": [(-1.1, 0.7), (0, 0), (1.1, -0.7)],
    },
    4: {
        "line": [(-1.8, 0), (-0.6, 0), (0.6, 0), (1.8, 0)],
        "diamond": [(-1.35, 0), (-0.35, 0.9), (0.35, -0.9), (1.35, 0)],
        "V": [(-1.6, 0.6), (-0.6, -0.4), (0.6, -0.4), (1.6, 0.6)],
        "box": [(-1.0, 0.7), (-0.6, -0.7), (0.6, 0.7), (1.0, -0.7)],
    },
    5: {
        "line": [(-2.2, 0), (-1.1, 0), (0, 0), (1.1, 0), (2.2, 0)],
        "V": [(-1.9, 0.7), (-0.95, 0), (0, -0.7), (0.95, 0), (1.9, 0.7)],
        "triangle": [(-1.7, -0.8), (-0.85, 0.1), (0, 0.9), (0.85, 0.1), (1.7, -0.8)],
        "circle": [(-1.35, 0), (-0.8, 1.05), (-0.2, -1.2), (0.8, 1.0), (1.35, -0.35)],
    },
}


def formation_names(n: int) -> list[str]:
    """Names of the formations for n dancers.

    >>> formation_names(2)
    ['line', 'diagonal', 'counter-diagonal']
    """
    return list(_FORMATIONS[n])


def slots(n: int, name: str) -> np.ndarray:
    """The places of a formation, left to right, (n, 2) metres.

    >>> slots(3, "line")[:, 0].tolist()
    [-1.3, 0.0, 1.3]
    """
    return np.array(_FORMATIONS[n][name], dtype=np.float64)


def min_distance(paths: np.ndarray) -> float:
    """Smallest distance between any two dancers at any time; paths (n, f, 2) -> metres.

    >>> min_distance(np.zeros((1, 5, 2)))
    inf
    """
    pairs = itertools.combinations(range(len(paths)), 2)
    gaps = [np.linalg.norm(paths[i] - paths[j], axis=-1).min() for i, j in pairs]
    return float(min(gaps, default=np.inf))


def curved_paths(start: np.ndarray, stop: np.ndarray, bulge: np.ndarray, steps: int) -> np.ndarray:
    r"""Straight lines with a sideways bow, so that two who change places can pass.

    $$p_i(u) = (1-u)\,a_i + u\,b_i + \beta_i \sin(\pi u)\, d_i^\perp$$

    Shapes: start, stop (n, 2), bulge (n,) metres -> (n, steps, 2).
    """
    u = np.linspace(0, 1, steps)[None, :, None]
    way = stop - start
    length = np.linalg.norm(way, axis=-1, keepdims=True)
    square = np.stack([-way[:, 1], way[:, 0]], -1) / np.maximum(length, 1e-9)
    bow = bulge[:, None, None] * np.sin(np.pi * u) * square[:, None]
    return start[:, None] * (1 - u) + stop[:, None] * u + bow


def plan_transition(start: np.ndarray, target: np.ndarray, rng: np.random.Generator, *, swap: bool):
    """Choose who goes to which slot, and bows that keep everybody apart.

    With ``swap`` two dancers exchange places in the left-to-right order if a safe way is found;
    without it (or if none is found) everybody keeps their rank.

    Shapes: start (n, 2) by dancer, target (n, 2) by slot -> stop (n, 2) by dancer, bulge (n,).
    """
    n = len(start)
    rank = np.argsort(np.argsort(start[:, 0]))
    if swap and n > 1:
        for _ in range(12):
            new = rank.copy()
            i, j = rng.choice(n, 2, replace=False)
            new[i], new[j] = rank[j], rank[i]
            for _ in range(20):
                bulge = rng.choice([-0.8, -0.45, 0.0, 0.45, 0.8], n)
                if min_distance(curved_paths(start, target[new], bulge, 24)) > MIN_DISTANCE:
                    return target[new], bulge
    for _ in range(60):
        bulge = rng.choice([-0.4, 0.0, 0.0, 0.4], n)
        if min_distance(curved_paths(start, target[rank], bulge, 24)) > MIN_DISTANCE:
            return target[rank], bulge
    return start.copy(), np.zeros(n)  # stay: always safe
