r"""How far the joints go in each move of a genre, found by dancing them."""

from dataclasses import replace
from functools import cache

import numpy as np

from dancediff.axes import FPS
from dancediff.data.choreographer.assemble import assemble, plan_parts
from dancediff.data.choreographer.grid import Grid, make_grid
from dancediff.data.choreographer.moves import Genre
from dancediff.data.choreographer.score import Count, Score
from dancediff.motion.skeleton import forward_kinematics

_EVERY = 3  # frames


@cache
def ways_of(genre: Genre) -> dict[str, float]:
    """Metres that the mean joint goes on a count of each move, danced in full by one dancer.

    >>> from dancediff.data.choreographer.genres import GENRES
    >>> ways = ways_of(GENRES["hiphop"])
    >>> ways["groove"] < ways["two step"] < ways["cross jump"]
    True
    """
    moves = (*genre.moves, *genre.travel, genre.rest)
    counts = [Count(move, k, False) for move in moves for k in range(genre.phrase)]
    num, spb = len(counts), 60 / (sum(genre.tempo) / 2)
    grid = make_grid(np.arange(num) * spb, int(num * spb * FPS))
    counts = [counts[0], *counts, *counts[:4]]  # frame 0 is on count 1
    score = Score([counts], np.zeros((1, len(counts), 2)))
    parts = plan_parts(score, genre, grid, 1.0, [0])
    way = way_on_counts(assemble(parts, genre, grid), grid, num + 1)[0, 1:]
    return dict(
        zip(
            (move.name for move in moves), way.reshape(len(moves), -1).mean(1).tolist(), strict=True
        )
    )


def way_on_counts(body, grid: Grid, num: int) -> np.ndarray:
    """Metres that the mean joint of each dancer goes around each count, (n, num).

    ``body`` are pose (n, f, 24, 3, 3) and root (n, f, 3) at the frames of ``grid``, and contacts.
    """
    pose, root, _ = body
    step = forward_kinematics(pose, root).diff(dim=1).norm(dim=-1).mean(-1).numpy()
    at = np.round(grid.beat[1:]).astype(int)
    return np.stack([np.bincount(at, row, num)[:num] for row in step])


def quick_look(score: Score, genre: Genre, grid: Grid) -> np.ndarray:
    """`way_on_counts` of a dance of which only every third frame is made, (n, k)."""
    few = replace(
        grid, beat=grid.beat[::_EVERY], spb=grid.spb / _EVERY, calm=grid.calm[::_EVERY],
        swing=grid.swing[::_EVERY],
    )  # fmt: skip
    style = replace(genre.style, smooth=genre.style.smooth / _EVERY)
    genre = replace(genre, style=style)
    parts = plan_parts(score, genre, few, 1.0, [0] * len(score.counts))
    return way_on_counts(assemble(parts, genre, few), few, len(score.counts[0]))
