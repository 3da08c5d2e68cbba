"""Exercises of lesson 13: Can you measure a dance?

Read first: lesson 13 · `dancediff.exercises`.
"""

from dataclasses import replace

import numpy as np
import torch

from dancediff.motion.motion import Motion

BEATS = np.arange(0.3, 6, 0.5)  # seconds


def _slides(foot):
    speed = 30 * foot[..., (0, 2)].diff(dim=0).norm(dim=-1)
    return (speed > 0.3).any(dim=1)


def _feet() -> list[tuple]:
    """A foot that slides all ways, a little under and over 30 cm/s; one is lifted, one stops."""
    angle = torch.arange(25) / 25 * 2 * torch.pi + 0.05
    way = torch.stack([angle.cos(), 0 * angle, angle.sin()], -1)
    step = way[:, None] * torch.tensor([0.25, 0.35, 0.45]).repeat(9)[:25, None, None] / 30
    both = step.expand(-1, 2, -1).cumsum(0)
    ankle, toe = torch.zeros_like(both), torch.zeros_like(both)
    ankle[:, 0], toe[:, 1] = both[:, 0], both[:, 1]
    lifted = both * torch.tensor([0.1, 0.0, 0.1])
    lifted[..., 1] = torch.arange(25)[:, None] / 60  # half a metre a second, upwards
    stops = both.clone()
    stops[9:] = both[9]
    return [(both,), (ankle,), (toe,), (lifted,), (stops,)]


def _dances() -> list[tuple]:
    from dancediff.data.choreographer import choreograph

    return [(choreograph(BEATS, dancers=n, seed=n, seconds=6)[0],) for n in (1, 2)]


def _other_kind(got, dance) -> str:
    if not isinstance(got, Motion):
        return f"type {type(got).__name__}, expected a Motion"
    if got.root.shape != dance.root.shape:
        return f"shape {tuple(got.root.shape)} of the root, expected {tuple(dance.root.shape)}"
    return ""


def _stand_still(dance):
    return replace(dance, pose=0 * dance.pose + dance.pose[:, :1], root=0 * dance.root)


def _fools_pfc(got, dance) -> str:
    from dancediff.metrics.physical import pfc
    from dancediff.metrics.rhythm import beat_alignment

    if wrong := _other_kind(got, dance):
        return wrong
    for name, metric in (("PFC", pfc), ("BAS", lambda joints: beat_alignment(joints, BEATS))):
        mine, its = metric(got.joints()), metric(dance.joints())
        if not mine <= its / 2:
            return f"your {name} is {mine:.3g}, expected at most half of the dance's {its:.3g}"
    return ""


def _rhythm(music, motion):
    from dancediff.metrics.rhythm import closeness

    return min(closeness(music, motion, 0.1), closeness(motion, music, 0.1))


_RESTS = {  # what to do with rests on the beats: at least, at most
    "on every beat": (0.9, 1.0),
    "50 ms late": (0.6, 1.0),
    "half a beat late": (0.0, 0.55),
    "in every frame": (0.0, 0.55),
    "on one beat, and no other": (0.0, 0.55),
}


def _rests(name: str, music):
    if name == "in every frame":
        return np.arange(0, music[-1] + 0.3, 1 / 30)
    if name == "on one beat, and no other":
        return music[3:4]
    return music + {"50 ms late": 0.05, "half a beat late": np.diff(music)[0] / 2}.get(name, 0.0)


def _rhythms() -> list[tuple]:
    grids = [np.arange(0.3, 10, period) for period in (0.5, 0.6)]  # 120 and 100 beats a minute
    return [(music, _rests(name, music)) for music in grids for name in _RESTS]


def _is_no_fool(got, music, motion) -> str:
    try:
        value = float(got)
    except (TypeError, ValueError):
        return f"type {type(got).__name__}, expected one number"
    where = {name: _rests(name, music) for name in _RESTS}
    name = next(k for k, v in where.items() if v.shape == motion.shape and np.allclose(v, motion))
    low, high = _RESTS[name]
    if not low <= value <= high + 1e-6:
        return f"rests {name}: yours {value:.2f}, expected {low:g} ... {high:g}"
    return ""


def _move(dance):
    return replace(dance, root=dance.root + torch.tensor([20.0, 0.0, 20.0]))


def _fools_published_energy(got, dance) -> str:
    from dancediff.metrics.kinetic import kinetic_features

    if wrong := _other_kind(got, dance):
        return wrong
    mine, its = got.joints(), dance.joints()
    a, b = kinetic_features(mine), kinetic_features(its)
    if not (a - b).norm() <= 0.01 * b.norm():
        return "the right features see another dance: they differ by more than 1 %"
    times = kinetic_features(mine, compat="gcd").mean() / kinetic_features(its, compat="gcd").mean()
    if not times >= 10:
        return f"the published features grow {times:.1f} times, expected 10 or more"
    return ""


def _frechet(x, r):
    from dancediff.metrics.fidelity import fid

    return fid(x, r)


def _crowds() -> list[tuple]:
    """Clouds that lie askew to each other; some are flat, one is a part of its reference."""
    draw = torch.Generator().manual_seed(0)
    cases = []
    for N, M, d in ((40, 60, 4), (12, 9, 6), (5, 30, 8)):
        x, r = (torch.randn(k, d, generator=draw, dtype=torch.float64) for k in (N, M))
        turn = torch.randn(2, d, d, generator=draw, dtype=torch.float64)
        scale = torch.logspace(-2, 2, d, dtype=torch.float64)  # of the features, in their units
        cases.append(((x @ turn[0] + 2) * scale, (r @ turn[1] + 1) * scale))
    x, r = cases[0]
    still = torch.full((60, 1), 0.2, dtype=torch.float64)  # a number that never changes
    cases.append((torch.cat([x, still[:40] + 0.5 * x[:, 1:2]], 1), torch.cat([r, still], 1)))
    return [*cases, (r[:30], r)]


SPECS = {
    "13.1": {"spec": _slides, "cases": _feet},
    "13.2": {"spec": _stand_still, "cases": _dances, "accepts": _fools_pfc},
    "13.3": {"spec": _rhythm, "cases": _rhythms, "accepts": _is_no_fool},
    "13.5": {"spec": _move, "cases": _dances, "accepts": _fools_published_energy},
    "13.6": {"spec": _frechet, "cases": _crowds},
}
