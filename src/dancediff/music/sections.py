r"""Sections of a song: intro, verse, chorus, bridge, break and outro, from its features alone.

Bars that sound alike are the same material. The loudest material that comes back is the chorus.

Read first: notebook 02 · Paulus, Müller and Klapuri 2010, "Audio-based music structure analysis".

Symbols (axes: f frames · q bars · d describing numbers · k materials)
    M   music features, raw                              (f, 35)
    X   what each bar sounds like, standardised          (q, d)
    C   mean of the bars of each material                (k, d)
"""

from itertools import pairwise

import numpy as np
import torch
from scipy.cluster.hierarchy import fcluster, linkage
from torch import Tensor

from dancediff.axes import FPS
from dancediff.music.energy import SLOPE, energy_curve
from dancediff.music.features import LATE, MFCC, ONSET, PEAKS, beat_frames

PHRASE = 8  # beats of a phrase
BAR = 4  # beats that are described together
LONGEST_BEAT = 2.2  # seconds; beats that are farther apart have a stretch without a beat between
_ALIKE = 0.9  # cosine distance up to which bars begin as the same material
_CHANGE = 0.85  # how much better another material must explain the bars that follow
_EVEN = 0.1  # what varies less, in units of MFCC or dB, counts as the same throughout
_SHARE = 0.1  # of the bars' time that a chorus takes at least
_ROUNDS = 5  # of assigning bars and averaging materials
_LOUD = 3  # weight of loudness among the describing numbers


def song_sections(M: Tensor) -> list[tuple[float, float, str]]:
    r"""Where the sections of a song begin and end, in seconds, and what they are.

    A bar of four beats is described by the means of MFCC and energy and by how much onset and
    timbre vary. Average linkage finds the materials; the best sequence of them minimises

    $$\sum_q \tfrac1d \lVert X_q - C_{k_q} \rVert^2 + 0.85\,[k_q \ne k_{q-1}]$$

    where each lasts for two bars at least. Stretches without a beat are the intro, the outro or a
    break. The chorus is the loudest material that returns, the verse another one that returns, the
    bridge one that does not.

    Source: ours. Shapes: M (f, 35), raw, of a whole song -> [(start, stop, label)] without gaps.
    Raises: ValueError when M has another shape or no frame.

    >>> song_sections(torch.zeros(300, 35))                            # a song without a beat
    [(0.0, 10.0, 'break')]
    """
    energy = energy_curve(M)
    runs = [_bars(run) for run in _runs(beat_frames(M))]
    if not runs:
        return [(0.0, len(M) / FPS, "break")]
    bars = [bar for run in runs for bar in run]
    materials = _materials(_described(M, energy, bars), [len(run) for run in runs])
    parts = _joined(bars, materials)
    full = energy + M[:, MFCC.start] / 128**0.5 / SLOPE  # how loud, and over how many bands
    return _in_seconds(_named(parts, full), len(M))


def phrase_similarity(M: Tensor, beats: np.ndarray) -> Tensor:
    r"""Cosine between phrases, each the features of its 8 beats, standardised over the song.

    Shapes: M (f, 35), beats (k,) frames -> (q, q) with q = (k - 1) // 8, none of fewer than 9.

    >>> M = torch.rand(80, 35).repeat(2, 1)                          # all of it twice
    >>> phrase_similarity(M, np.arange(0, 161, 10)).round(decimals=3).tolist()
    [[1.0, 1.0], [1.0, 1.0]]
    """
    q = max(len(beats) - 1, 0) // PHRASE
    if not q:
        return M.new_zeros(0, 0)
    sound = M[:, : PEAKS.start]
    per_beat = torch.stack([sound[a:b].mean(0) for a, b in pairwise(beats)])
    per_beat = (per_beat - per_beat.mean(0)) / per_beat.std(0).clamp_min(1e-6)
    phrases = per_beat[: q * PHRASE].reshape(q, -1)
    phrases = torch.nn.functional.normalize(phrases, dim=-1)
    return phrases @ phrases.T


def _runs(beats: np.ndarray) -> list[np.ndarray]:
    """Frames of beats that follow each other without a stretch between them, at least a bar."""
    runs = np.split(beats, np.flatnonzero(np.diff(beats) > LONGEST_BEAT * FPS) + 1)
    return [run for run in runs if len(run) > BAR]


def _bars(run: np.ndarray) -> list[tuple[int, int]]:
    """First and last frame (not included) of each bar; the last one ends a beat after the run.

    Less than half a bar is no bar of its own.

    >>> _bars(np.arange(0, 60, 10)), _bars(np.arange(0, 50, 10))
    ([(0, 40), (40, 60)], [(0, 50)])
    """
    starts = run[::BAR][: max(1, (len(run) + BAR // 2) // BAR)]
    return list(pairwise([*starts.tolist(), int(2 * run[-1] - run[-2])]))


def _described(M: Tensor, energy: Tensor, bars: list[tuple[int, int]]) -> np.ndarray:
    """X: what each bar sounds like."""
    rows = []
    for start, stop in bars:
        part, timbre = M[start:stop], M[start:stop, MFCC]
        deviation = part[:, ONSET.start : MFCC.start + 8].std(0, correction=0)
        loud = SLOPE * energy[start:stop].mean().expand(_LOUD)
        rows.append(torch.cat([timbre.mean(0), deviation, part[:, ONSET].mean(0), loud]))
    X = torch.stack(rows).double().numpy()
    # what hardly varies in the whole song is no difference between two bars
    return (X - X.mean(0)) / (X.std(0) + _EVEN)


def _materials(X: np.ndarray, runs: list[int]) -> np.ndarray:
    """Number of the material of each bar, (q, d) -> (q,); ``runs`` of bars have pauses between."""
    if len(X) < 3:
        return np.zeros(len(X), int)
    unit = X / (np.linalg.norm(X, axis=1, keepdims=True) + 1e-9)
    found = fcluster(linkage(unit, "average"), (2 * _ALIKE) ** 0.5, "distance")
    for _ in range(_ROUNDS):
        kinds, count = np.unique(found, return_counts=True)
        kinds = kinds[count > 1] if (count > 1).any() else kinds
        C = np.stack([X[found == kind].mean(0) for kind in kinds])
        costs = np.split(((X[:, None] - C) ** 2).mean(-1), np.cumsum(runs)[:-1])
        found = np.concatenate([_best_sequence(cost) for cost in costs])
    return found


def _best_sequence(cost: np.ndarray) -> np.ndarray:
    """The sequence of materials, each for two bars or more, with the least cost; (q, k) -> (q,).

    >>> _best_sequence(np.array([[0, 9], [1, 1], [9, 0], [0, 9], [9, 0], [9, 0.0]])).tolist()
    [0, 0, 1, 1, 1, 1]
    """
    q, k = cost.shape
    if q < 2:
        return cost.argmin(1)
    total = np.full((q, k), np.inf)
    total[1] = cost[0] + cost[1]
    new = np.full((q, k), -1)  # the material before, where a bar is the second one of its own
    for bar in range(2, q):
        go_on = total[bar - 1] + cost[bar]
        change = total[bar - 2].min() + _CHANGE + cost[bar - 1] + cost[bar]
        new[bar] = np.where(change < go_on, total[bar - 2].argmin(), -1)
        total[bar] = np.minimum(go_on, change)
    material, bar, path = int(total[-1].argmin()), q - 1, []
    while bar >= 0:
        path.append(material)
        if new[bar, material] >= 0:
            path.append(material)
            material, bar = int(new[bar, material]), bar - 1
        bar -= 1
    return np.array(path[::-1])


def _joined(bars: list[tuple[int, int]], materials: np.ndarray) -> list[tuple[int, int, int]]:
    """Neighbours of one material are one part: first frame, last frame, material.

    >>> _joined([(0, 9), (9, 18), (20, 29)], np.array([0, 0, 0]))
    [(0, 18, 0), (20, 29, 0)]
    """
    parts: list[tuple[int, int, int]] = []
    for (start, stop), material in zip(bars, materials.tolist(), strict=True):
        if parts and parts[-1][1:] == (start, material):
            parts[-1] = (parts[-1][0], stop, material)
        else:
            parts.append((start, stop, material))
    return parts


def _named(parts: list[tuple[int, int, int]], full: Tensor) -> list[tuple[int, int, str]]:
    """Parts with the names of sections."""
    times = {k: [full[a:b] for a, b, m in parts if m == k] for _, _, k in parts}
    level = {k: torch.cat(heard).mean().item() for k, heard in times.items()}
    returning = [k for k, heard in times.items() if len(heard) > 1]
    least = _SHARE * sum(b - a for a, b, _ in parts)
    often = [k for k in returning if sum(map(len, times[k])) >= least]
    chorus = max(often, key=level.__getitem__) if often else None

    def name(place: int, material: int) -> str:
        if chorus is None:
            return "verse"
        if material == chorus:
            return "chorus"
        outside = place in (0, len(parts) - 1)
        if outside and (material not in returning or level[material] == min(level.values())):
            return "outro" if place else "intro"
        return "verse" if material in returning else "bridge"

    return [(a, b, name(place, k)) for place, (a, b, k) in enumerate(parts)]


def _in_seconds(parts: list[tuple[int, int, str]], frames: int) -> list[tuple[float, float, str]]:
    """Parts without gaps from 0 to the end: stretches without a beat are sections, too.

    >>> _in_seconds([(120, 300, "verse"), (450, 600, "verse"), (620, 800, "chorus")], 1200)[::2]
    [(0.0, 3.955, 'intro'), (9.955, 14.955, 'break'), (20.622, 26.622, 'chorus')]
    """
    longest, whole, end = LONGEST_BEAT * FPS, [], 0
    for start, stop, label in parts:
        if start - end > longest:
            whole.append((end, "break" if end else "intro"))
        whole.append((start, label))
        end = min(stop, frames)
    if frames - end > longest:
        whole.append((end, "outro"))
    borders = [0.0, *(round(start / FPS - LATE, 3) for start, _ in whole[1:]), frames / FPS]
    return [(*span, name) for span, (_, name) in zip(pairwise(borders), whole, strict=True)]
