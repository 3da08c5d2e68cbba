"""Exercises of lessons 00 to 04: dances as tensors, music, data, noise."""

import numpy as np
import torch

from dancediff.diffusion.schedule import cosine_abar, q_sample
from dancediff.exercises.exercise import Exercise
from dancediff.motion.representation import Normalizer
from dancediff.motion.rotation import (
    axis_angle_to_matrix,
    matrix_to_rot6d,
    rot6d_to_matrix,
    rotation_about,
)
from dancediff.motion.skeleton import SMPL24, forward_kinematics, world_rotations
from dancediff.music.features import BEATS, FPS, HOP

LEFT_ARM = [SMPL24.index(name) for name in ("lshoulder", "lelbow", "lwrist")]
GRAVITY = 9.81  # m/s²


def _raise_hand(pose):
    pose = pose.clone()
    pose[LEFT_ARM] = torch.eye(3)
    collar = world_rotations(pose)[SMPL24.index("lcollar")]
    pose[LEFT_ARM[0]] = collar.mT @ rotation_about("z", torch.tensor(torch.pi / 2))
    return pose


def _poses() -> list[tuple]:
    turns = 0.5 * torch.randn(3, 24, 3, generator=torch.Generator().manual_seed(2))
    turns[0, 0] = torch.tensor([0.0, 0.0, 1.6])  # lies on the side
    turns[1, 0] = torch.tensor([1.2, 0.0, 0.0])  # bows
    return [(pose,) for pose in axis_angle_to_matrix(turns)]


def _raised(got, pose) -> str:
    if tuple(got.shape) != (24, 3, 3):
        return f"shape {tuple(got.shape)}, expected (24, 3, 3)"
    if not _are_rotations(got):
        return "some of your matrices are no rotations: they bend the bones"
    others = [j for j in range(24) if j not in LEFT_ARM]
    if not torch.allclose(got[others], pose[others], atol=1e-4):
        return "you have turned other joints, too; expected only 16, 18 and 20"
    joints = forward_kinematics(got, torch.zeros(3))
    up = (joints[SMPL24.index("lhand")] - joints[LEFT_ARM[0]])[1].item()
    return "" if up >= 0.55 else f"the hand is {up:.2f} m above its shoulder, expected 0.55 or more"


def _are_rotations(R) -> bool:
    square = torch.allclose(R @ R.mT, torch.eye(3).expand_as(R), atol=1e-3)
    return square and bool((torch.linalg.det(R) > 0).all())


def _two_near():
    return [1.0, 0, 0, 1, 0.004, 0], [1.0, 0, 0, 1, -0.004, 0]


def _jumps(got) -> str:
    pair = torch.stack([torch.as_tensor(d6).float().reshape(6) for d6 in got])
    if len(pair) != 2:
        return f"{len(pair)} answers, expected two"
    if pair.unflatten(-1, (2, 3)).norm(dim=-1).min() < 1:
        return "one of your rows is shorter, expected a length of 1 or more"
    if (apart := (pair[0] - pair[1]).abs().max().item()) > 0.0101:
        return f"yours differ by {apart:.3g}, expected at most 0.01"
    R = rot6d_to_matrix(pair)
    if not _are_rotations(R):
        return "one of yours is no rotation at all: its rows are parallel, not nearly parallel"
    angle = torch.rad2deg(torch.acos(((torch.trace(R[0].mT @ R[1]) - 1) / 2).clamp(-1, 1))).item()
    return "" if angle >= 90 else f"your rotations are {angle:.0f} degrees apart, expected 90"


def _tempo(M):
    return 60 * FPS / float(np.median(np.diff(np.flatnonzero(np.asarray(M)[:, BEATS.start] > 0.5))))


def _tempo_cases() -> list[tuple]:
    steady, gap = torch.zeros(300, 35), torch.zeros(300, 35)
    steady[7::15, BEATS] = 1  # 120 beats a minute
    gap[7::20, BEATS] = 1  # 90, and the tracker has missed two
    gap[[67, 187], BEATS] = 0
    return [(steady,), (gap,)]


class _Rises:
    """Loudness rises, and their share of the largest one: features that need the whole song."""

    def __call__(self, sound):
        frames = 1 + len(sound) // HOP
        padded = np.pad(np.abs(sound), (0, frames * HOP - len(sound)))
        loud = padded.reshape(frames, HOP).mean(1)
        rises = np.maximum(0, np.diff(loud, prepend=loud[0]))
        return np.stack([rises, rises / rises.max()], axis=1)

    def __repr__(self):
        return "features"


def _cut_last(sound, starts, features):
    M = features(sound)
    return np.stack([M[start : start + 150] for start in starts])


def _cut_cases() -> list[tuple]:
    sound = np.random.default_rng(0).normal(size=400 * HOP + 100)
    sound *= np.repeat(np.random.default_rng(1).random(401), HOP)[: len(sound)]
    return [(sound, [0, 75, 250], _Rises()), (sound[: 200 * HOP], [7], _Rises())]


def _same_windows(got, *case) -> str:
    want = _cut_last(*case)
    got = np.asarray(got)
    if got.shape != want.shape:
        return f"shape {got.shape}, expected {want.shape}"
    wrong = np.flatnonzero(~np.isclose(got, want).all(axis=(0, 2)))
    return f"frame {wrong[0]} of your windows is not that of the song" if len(wrong) else ""


def _new_tone():
    S = np.full((128, 2), -40.0)
    S[:64, 1], S[64:, 1] = -60, -20
    return S


def _hears_a_tone(got) -> str:
    S = np.asarray(got, dtype=float)
    if S.shape != (128, 2):
        return f"shape {S.shape}, expected (128, 2)"
    if not ((S >= -80) & (S <= 0)).all():
        return "some of your numbers are outside -80 … 0 decibels"
    change = S[:, 1] - S[:, 0]
    onset = np.maximum(0, change).mean()
    if onset < 5 - 1e-6:
        return f"the onset strength is {onset:.1f}, expected 5 or more"
    shortcut = max(0, change.mean())
    return f"the shortcut hears {shortcut:.1f}, expected 0" if shortcut > 1e-6 else ""


def _rotation_cases() -> list[tuple]:
    R = axis_angle_to_matrix(torch.tensor([[0.3, -1.1, 0.4], [0.0, 2.0, 1.0]]))
    d6 = matrix_to_rot6d(R)
    stretched = d6 * torch.tensor([2.0, 2, 2, 0.5, 0.5, 0.5])
    bent = stretched + 0.3 * stretched[..., [3, 4, 5, 0, 1, 2]]  # the rows are no longer square
    return [(d6,), (stretched,), (bent,)]


def _leaks(train, test):
    return sum(any(a == b and abs(s - t) < 150 for b, t in train) for a, s in test)


def _leaks_cases() -> list[tuple]:
    grid = [(take, start) for take in "abc" for start in range(0, 451, 75)]
    by_take = ([w for w in grid if w[0] != "b"], [w for w in grid if w[0] == "b"])
    apart = ([("a", 0), ("b", 150)], [("a", 150), ("b", 0), ("c", 0)])  # they touch, no more
    return [(grid[::2], grid[1::2]), by_take, apart, ([("a", 100), ("a", 130)], [("a", 0)])]


def _true_fps(height):
    return float((GRAVITY / -height.diff(n=2).mean()) ** 0.5)


def _jump_cases() -> list[tuple]:
    cases = []
    for fps, frames, speed in ((60, 20, 2.0), (120, 41, 2.4), (30, 9, 0.7)):
        time = torch.arange(frames, dtype=torch.float64) / fps
        cases.append((1 + speed * time - GRAVITY / 2 * time**2,))
    return cases


def _split(takes):
    groups: list = []
    for name, song, parts in takes:
        ties = {name, ("song", song), *parts}
        groups = [g for g in groups if not g & ties] + [
            ties.union(*(g for g in groups if g & ties))
        ]
    test: set = set()
    for group in sorted(groups, key=len):
        if len(test) < len(takes) / 10:
            test |= {name for name, *_ in takes if name in group}
    return test


def _take_cases() -> list[tuple]:
    plain = [(f"take{k}", f"song{k % 7}", ()) for k in range(20)]
    # duets, and groups put together from them: no song can be held out without its ties
    songs = ("tango", "salsa", "salsa", "waltz", "swing", "swing", "polka", "samba", "disco")
    duets = [(f"d{k}", song, ()) for k, song in enumerate(songs)]
    groups = [("g01", "tango", ("d0", "d1")), ("g23", "salsa", ("d2", "d3"))]
    groups += [("g46", "swing", ("d4", "d6")), ("g78", "samba", ("d7", "d8"))]
    return [(plain,), (duets + groups,), ((duets + groups)[::-1],)]


def _splits(got, takes) -> str:
    test = set(got)
    if strange := test - {name for name, *_ in takes}:
        return f"there is no take {sorted(map(str, strange))[0]!r}"
    if not 0.1 <= len(test) / len(takes) <= 0.4:
        return f"{len(test)} of {len(takes)} takes are test takes, expected a tenth to four tenths"
    for side in (test, {name for name, *_ in takes} - test):
        if torn := [n for n, _, parts in takes if n in side and not set(parts) <= side]:
            return f"{torn[0]!r} and a take it was made from are on two sides"
    songs = [{song for name, song, _ in takes if (name in test) == side} for side in (True, False)]
    return f"both sides dance to {min(songs[0] & songs[1])!r}" if songs[0] & songs[1] else ""


def _rescale(train, new):
    return Normalizer.fit(train).normalize(new)


def _clip_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    train = torch.rand(3, 6, 4, generator=draw) * torch.tensor([5.0, 1, 2, 1])
    train[..., 3] = torch.tensor([0.0, 1, 0])[:, None]  # a contact that is constant in each clip
    new = torch.rand(2, 6, 4, generator=draw) * torch.tensor([8.0, 2, 1, 1])  # goes further
    new[..., 3] = torch.tensor([1.0, 0])[:, None]
    return [(train, new), (train, train[2:])]


def _further(x_s, s, t, abar, eps):
    left = abar[t] / abar[s]
    return left.sqrt() * x_s + (1 - left).sqrt() * eps


def _further_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    x_s, eps = (torch.randn(2, 3, 4, generator=draw, dtype=torch.float64) for _ in range(2))
    return [(x_s, s, t, cosine_abar(1000), eps) for s, t in ((300, 600), (599, 600), (0, 900))]


def _noise_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    return [(torch.randn(3, 20, 151, generator=draw, dtype=torch.float64), cosine_abar(1000))]


def _fool_the_loss(eps, abar):
    return 950, eps + 0.1


def _fools_the_loss(got, eps, abar) -> str:
    t, guess = got
    if t != int(t) or not 0 <= t <= 960:
        return f"t = {t}, expected a step from 0 to 960"
    if guess.shape != eps.shape:
        return f"shape {tuple(guess.shape)} of the guess, expected {tuple(eps.shape)}"
    loss = ((guess - eps) ** 2).mean().item()
    if not loss <= 0.01 + 1e-6:
        return f"the loss is {loss:.3g}, expected at most 0.01"
    a = abar[int(t)].item()
    error = (loss * (1 - a) / a) ** 0.5
    return "" if error >= 1 else f"the dance is wrong by {error:.2f}, expected 1 or more"


def _even_abar(num_steps):
    return torch.linspace(0.99, 0.0005, num_steps)


def _is_a_plan(got, num_steps) -> str:
    abar = torch.as_tensor(got).double()
    if abar.shape != (num_steps,):
        return f"shape {tuple(abar.shape)}, expected ({num_steps},)"
    if not (abar > 0).all() or not (abar[:-1] > abar[1:]).all():
        return "some of your numbers do not fall, or are not above 0"
    if not 0.95 <= abar[0] <= 1 or not abar[-1] <= 0.001 + 1e-6:
        return (
            f"yours goes from {abar[0]:.3g} to {abar[-1]:.3g}, expected 0.95 … 1 to 0.001 or less"
        )
    middle = ((abar > 0.1) & (abar < 0.9)).double().mean().item()
    return "" if middle >= 0.7 else f"{middle:.0%} of the steps are in the middle, expected 70%"


def _x0_from(x_t, eps, t, abar):
    return (x_t - (1 - abar[t]).sqrt() * eps) / abar[t].sqrt()


def _x0_cases() -> list[tuple]:
    draw = torch.Generator().manual_seed(0)
    abar = cosine_abar(1000)
    x_0, eps = (torch.randn(2, 3, 4, generator=draw, dtype=torch.float64) for _ in range(2))
    return [(q_sample(x_0, t, abar, eps), eps, t, abar) for t in (0, 250, 800)]


EXERCISES = {
    "00.1": Exercise(
        "a seed names a dance",
        {"same seed again": True, "another seed": False, "another song": False},
        "a seed fixes the noise a dance starts from; noise, song and settings fix the rest",
    ),
    "00.2": Exercise(
        "all at once",
        {"twice the steps": 2, "twice the dancers": 1, "twice the seconds": 1},
        "a guess is a guess of the whole dance: all dancers, all frames; only the steps say how "
        "often the network guesses",
    ),
    "01.1": Exercise(
        "six numbers to a rotation",
        rot6d_to_matrix,
        "rows: make the first one unit length, take its share out of the second, make that unit "
        "length too; the third is their cross product, in this order",
        _rotation_cases,
    ),
    "01.2": Exercise(
        "what comes along",
        {"18 left elbow": 2, "22 left hand": 0, "9 chest": 12, "0 root": 23},
        "a turn moves what hangs below the joint, never the joint itself; count the joints below "
        "in the picture of the skeleton",
    ),
    "01.3": Exercise(
        "raise your hand",
        _raise_hand,
        "in the world the shoulder is turned by Q[13] @ R[16]: choose R[16] so that this is a "
        "quarter turn about z, and let elbow and wrist be straight",
        _poses,
        _raised,
    ),
    "01.4": Exercise(
        "find the jump",
        _two_near,
        "the second row loses its share of the first one: what is left when the two point nearly "
        "the same way, and how long is it before it is made unit length?",
        accepts=_jumps,
    ),
    "02.1": Exercise(
        "beats per minute",
        _tempo,
        f"column 34 marks beats at {FPS} frames a second; the tracker may miss a beat, so take "
        "the median of the gaps, not their mean",
        _tempo_cases,
    ),
    "02.2": Exercise(
        "half as loud",
        {"onset": False, "mfcc": True, "chroma": False, "peaks": False, "beats": False},
        "in decibels half as loud is 6 less, in every band and every frame; what does a difference "
        "of two frames see of it? And what still says how loud it is?",
    ),
    "02.3": Exercise(
        "cut last",
        _cut_last,
        "call features once, on the whole sound; then take the rows start … start + 149 for each "
        "start",
        _cut_cases,
        _same_windows,
    ),
    "02.4": Exercise(
        "band by band",
        _new_tone,
        "let some bands get much louder while others get as much softer: one tone ends where "
        "another begins",
        accepts=_hears_a_tone,
    ),
    "03.1": Exercise(
        "find the leak",
        _leaks,
        "two windows share a frame when they are of one take and their starts differ by less than "
        "150, to either side; count each test window once",
        _leaks_cases,
    ),
    "03.2": Exercise(
        "the header lies",
        _true_fps,
        "the second difference, height.diff(n=2), is -9.81 divided by the frame rate, squared",
        _jump_cases,
    ),
    "03.3": Exercise(
        "split it safely",
        _split,
        "make groups of takes that are tied, by a song or by a part, and by ties of ties; then put "
        "whole groups into the test set until it is large enough",
        _take_cases,
        _splits,
    ),
    "03.4": Exercise(
        "one scale for all",
        _rescale,
        "one minimum and one maximum for each channel, over all clips and frames of train "
        "alone; new may go beyond -1 … 1",
        _clip_cases,
    ),
    "04.1": Exercise(
        "undo the noise",
        _x0_from,
        "solve x_t = √ᾱ x_0 + √(1-ᾱ) ε for x_0, with ᾱ = abar[t]; mind both roots",
        _x0_cases,
    ),
    "04.2": Exercise(
        "walk on",
        _further,
        "the share abar[t] / abar[s] of the power is kept; noise makes up the rest to 1",
        _further_cases,
    ),
    "04.3": Exercise(
        "what drowns first",
        {"sway": 650, "kick": 310, "tremble": 70},
        "the noise is as strong in a slow movement as in a fast one; which of the three is the "
        "largest in metres?",
    ),
    "04.4": Exercise(
        "small loss, broken dance",
        _fool_the_loss,
        "the loss allows an error of 0.1 in every number of the noise; from which step on does it "
        "arrive ten times larger?",
        _noise_cases,
        _fools_the_loss,
    ),
    "04.5": Exercise(
        "your own plan",
        _even_abar,
        "spread the steps evenly over the power itself; end above 0, so that nobody divides by it",
        lambda: [(1000,), (50,)],
        _is_a_plan,
    ),
}
