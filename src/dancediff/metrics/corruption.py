r"""Damage a good dance by a known amount, to see whether a metric notices.

Read first: lesson 13 · `dancediff.motion.motion`.

Every corruption takes a motion, an amount in [0, 1] and a numpy generator (`collapse` a list of
motions, `shift_beats` beats) and returns one of the same size; amount 0 gives the same numbers
back, bit for bit, and the same generator state gives the same damage. Another amount raises a
ValueError. Contact labels are dropped where the damage makes them wrong.

Symbols (axes: n dancers · f frames · j joints)
    amount  how much is broken, 0 nothing .. 1 everything
    pose    rotation of each joint relative to its parent   (n, f, j, 3, 3)
    root    pelvis position, metres, y up                   (n, f, 3)
"""

from dataclasses import replace

import numpy as np
import roma
import torch

from dancediff.axes import ON_FLOOR
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import axis_angle_to_matrix

PIECE = 0.5  # seconds; what shuffle_time moves around
DRAG_SPEED = 1.0  # metres a second, the fastest that feet are dragged
DRAG_PERIOD = 2.0  # seconds of one drag there and back
JITTER_ANGLE = 0.15  # radians, standard deviation about each axis of each joint
JITTER_ROOT = 0.02  # metres, standard deviation along each axis


def freeze(motion: Motion, amount: float, generator: np.random.Generator) -> Motion:
    r"""Stop early: the last ``amount`` of the frames repeat the pose before them.

    $$x'_i = x_{\min(i,\,k)},\quad k = \mathrm{round}((1 - a)(f - 1))$$

    Nothing is drawn from the generator.

    >>> walk = Motion(torch.eye(3).expand(1, 5, 24, 3, 3), torch.arange(15.0).view(1, 5, 3))
    >>> freeze(walk, 0.5, np.random.default_rng(0)).root[0, :, 0].tolist()
    [0.0, 3.0, 6.0, 6.0, 6.0]
    """
    if not _amount(amount):
        return motion
    last = round((1 - amount) * (motion.num_frames - 1))
    return _reorder(motion, np.minimum(np.arange(motion.num_frames), last))


def shuffle_time(motion: Motion, amount: float, generator: np.random.Generator) -> Motion:
    r"""Cut a stretch of the dance, ``amount`` of it, into half seconds and mix these.

    All dancers change together, so each frame stays a frame that was danced. Where the stretch
    lies and who goes where is drawn; no piece comes back to its place.

    Raises: ValueError for a motion shorter than 2 pieces.

    >>> walk = Motion(torch.eye(3).expand(1, 45, 24, 3, 3), torch.arange(135.0).view(1, 45, 3))
    >>> out = shuffle_time(walk, 1.0, np.random.default_rng(0)).root
    >>> sorted(out[0, :, 0].tolist()) == walk.root[0, :, 0].tolist()
    True
    """
    if not _amount(amount):
        return motion
    length = max(1, round(PIECE * motion.fps))
    pieces = np.array_split(np.arange(motion.num_frames), range(length, motion.num_frames, length))
    if len(pieces) < 2:
        raise ValueError(
            f"motion has {motion.num_frames} frames, one piece; shuffle_time needs 2 x {PIECE} s"
        )
    stretch = max(2, round(amount * len(pieces)))
    first = generator.integers(len(pieces) - stretch + 1)
    ring = first + generator.permutation(stretch)  # each piece goes where the next one was
    order = list(pieces)
    for here, there in zip(ring, np.roll(ring, 1), strict=True):
        order[here] = pieces[there]
    return _reorder(motion, np.concatenate(order))


def drag_feet(motion: Motion, amount: float, generator: np.random.Generator) -> Motion:
    r"""Slide each dancer to and fro over the floor, at up to ``amount`` x 1 m/s.

    $$p' = p + a\,\frac{v\,T}{2\pi}\Big(\sin\big(\tfrac{2\pi\,\text{sec}}{T} + \varphi\big)
      - \sin\varphi\Big)\,d,\quad v = 1\text{ m/s},\; T = 2\text{ s}$$

    The direction d and the phase are drawn for each dancer. The steps stay as they were, so
    planted feet skate, as they do in motion whose root and legs disagree.

    >>> still = Motion(torch.eye(3).expand(2, 30, 24, 3, 3), torch.zeros(2, 30, 3))
    >>> drag_feet(still, 1.0, np.random.default_rng(0)).root[..., 1].abs().max().item()
    0.0
    """
    if not _amount(amount):
        return motion
    angle, phase = generator.uniform(0, 2 * np.pi, (2, motion.num_dancers, 1))
    omega = 2 * np.pi / DRAG_PERIOD
    wave = np.sin(omega * np.arange(motion.num_frames) / motion.fps + phase) - np.sin(phase)
    path = amount * DRAG_SPEED / omega * wave
    drag = np.stack([path * np.cos(angle), 0 * path, path * np.sin(angle)], -1)
    return replace(motion, root=motion.root + torch.from_numpy(drag).float(), contact=None)


def overlap_dancers(motion: Motion, amount: float, generator: np.random.Generator) -> Motion:
    r"""Pull all dancers towards the middle of the group; at 1 they stand in one place.

    $$p'_{xz} = (1 - a)\,p_{xz} + a\,\bar p_{xz}$$

    with the mean over dancers in each frame. Nothing is drawn from the generator.

    Raises: ValueError for one dancer.

    >>> root = torch.tensor([[[0.0, 1, 0]], [[2, 1, 0]]])
    >>> pair = Motion(torch.eye(3).expand(2, 1, 24, 3, 3), root)
    >>> overlap_dancers(pair, 0.5, np.random.default_rng(0)).root[:, 0, 0].tolist()
    [0.5, 1.5]
    """
    if motion.num_dancers < 2:
        raise ValueError("motion has 1 dancer; overlap_dancers needs 2 or more")
    if not _amount(amount):
        return motion
    root = motion.root.clone()
    floor = root[..., ON_FLOOR]
    root[..., ON_FLOOR] = (1 - amount) * floor + amount * floor.mean(0)
    return replace(motion, root=root, contact=None)


def jitter(motion: Motion, amount: float, generator: np.random.Generator) -> Motion:
    r"""Shake every joint and the root anew in each frame.

    $$R' = R \cdot \exp(a\,\epsilon),\; \epsilon \sim N(0, 0.15^2)\text{ rad},\quad
      p' = p + a\,\eta,\; \eta \sim N(0, 0.02^2)\text{ m}$$

    >>> still = Motion(torch.eye(3).expand(1, 9, 24, 3, 3), torch.zeros(1, 9, 3))
    >>> 0 < jitter(still, 1.0, np.random.default_rng(0)).root.abs().max().item() < 0.12
    True
    """
    if not _amount(amount):
        return motion
    turn = amount * JITTER_ANGLE * generator.standard_normal(motion.pose.shape[:-1])
    step = amount * JITTER_ROOT * generator.standard_normal(motion.root.shape)
    pose = motion.pose @ axis_angle_to_matrix(torch.from_numpy(turn).float())
    root = motion.root + torch.from_numpy(step).float()
    return replace(motion, pose=pose, root=root, contact=None)


def mean_pose(motion: Motion, amount: float, generator: np.random.Generator) -> Motion:
    r"""Blend every pose with the dancer's mean pose; at 1 a statue glides along the path.

    $$R' = \bar R\,\exp\big((1 - a)\log(\bar R^\top R)\big),\quad
      p'_y = (1 - a)\,p_y + a\,\bar p_y$$

    where the mean rotation is the one nearest to the mean matrix over time. This is what a network
    does that has learned the average only. The path over the floor stays, so that the statue
    differs from a frozen dancer. Nothing is drawn from the generator.

    >>> nod = axis_angle_to_matrix(torch.tensor([[0.3, 0, 0], [-0.3, 0, 0]]))
    >>> dance = Motion(nod[None, :, None].expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3))
    >>> statue = mean_pose(dance, 1.0, np.random.default_rng(0))
    >>> torch.allclose(statue.pose, torch.eye(3), atol=1e-6)
    True
    """
    if not _amount(amount):
        return motion
    mean = roma.special_procrustes(motion.pose.mean(1, keepdim=True))
    away = roma.rotmat_to_rotvec((mean.mT @ motion.pose).contiguous())
    root = motion.root.clone()
    root[..., 1] = torch.lerp(root[..., 1], root[..., 1].mean(1, keepdim=True), amount)
    pose = mean @ axis_angle_to_matrix((1 - amount) * away)
    return replace(motion, pose=pose, root=root, contact=None)


def collapse(dances: list[Motion], amount: float, generator: np.random.Generator) -> list[Motion]:
    r"""Replace ``amount`` of the other dances of a set by one of them: mode collapse.

    The dance that takes over, and the order in which the others go, are drawn. Each dance stays as
    good as it was, so only a metric of the set, as diversity, can notice.

    Raises: ValueError for fewer than 2 dances.

    >>> pose, root = torch.eye(3).expand(1, 2, 24, 3, 3), torch.zeros(1, 2, 3)
    >>> dances = [Motion(pose, root), Motion(pose, root + 1)]
    >>> one, two = collapse(dances, 1.0, np.random.default_rng(0))
    >>> one is two
    True
    """
    if len(dances) < 2:
        raise ValueError(f"dances holds {len(dances)}; collapse needs 2 or more")
    if not _amount(amount):
        return list(dances)
    first, *others = generator.permutation(len(dances))
    gone = set(others[: round(amount * len(others))])
    return [dances[first] if k in gone else dance for k, dance in enumerate(dances)]


def shift_beats(beats, amount: float, generator: np.random.Generator) -> np.ndarray:
    r"""Move every beat, earlier or later, by up to ``amount`` x half a beat.

    $$b'_k = b_k + a\,u_k\,\tfrac12\,\mathrm{median}(\Delta b),\quad u_k \sim U(-1, 1)$$

    Each beat moves by itself: one shift for all would only move the music against a dance that is
    a little early or late, which at first can even help.

    Shapes: beats (k,) seconds -> (k,), in order.
    Raises: ValueError for fewer than 2 beats.

    >>> shift_beats([0.5, 1.0, 1.5], 0.0, np.random.default_rng(0)).tolist()
    [0.5, 1.0, 1.5]
    """
    beats = np.asarray(beats, dtype=np.float64)
    if beats.ndim != 1 or len(beats) < 2:
        raise ValueError(f"beats has shape {beats.shape}; shift_beats needs 2 or more times in s")
    if not _amount(amount):
        return beats
    reach = amount * np.median(np.diff(beats)) / 2
    return np.sort(beats + reach * generator.uniform(-1, 1, len(beats)))


def _amount(amount: float) -> float:
    if not 0 <= amount <= 1:
        raise ValueError(f"amount={amount} is not in [0, 1]")
    return amount


def _reorder(motion: Motion, frames: np.ndarray) -> Motion:
    index = torch.from_numpy(frames)
    contact = None if motion.contact is None else motion.contact[:, index]
    return replace(motion, pose=motion.pose[:, index], root=motion.root[:, index], contact=contact)
