"""Batches of the packaged recipes are bit-identical to those that trained the packaged models.

The digests were made with the samplers before there was one for all models: `GroupDanceWindows`,
`SoloWindows`. Those of "global" are newer than the packaged weights: soft primitives are chosen by
kinematic energy now.
"""

from hashlib import sha256

import numpy as np
import pytest
import torch

from dancediff.data.augment import Augmentation
from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, SoloCut, WindowSampler
from dancediff.motion.representation import pack
from dancediff.papers.lodge.primitives import Layout
from dancediff.training.lodge_data import PrimitiveCut, half_windows, long_enough

GROUPS = [  # dancers, frames, kind, songs
    *[(1, 200, "synthetic", 1), (2, 220, "synthetic", 1), (3, 300, "synthetic", 1)],
    *[(3, 180, "composed", 3), (2, 260, "real", 3), (1, 400, "real", 3), (5, 170, "synthetic", 1)],
]
SOLOS = [(300, "synthetic", 1), (260, "synthetic", 1), (140, "real", 3), (520, "real", 2)]
GENRES = ("hiphop", "salsa", "indian")
PACKAGED = {"dancers_per_batch": 16, "real": 0.2, "seed": 0}
FOUND = {
    "tcdiffpp": [
        "251b1f313ddc",
        "24945954cb09",
        "3093532117e1",
        "d4c810d1029f",
        "fa85fc27984a",
        "e36f289506d3",
    ],
    "edge": [
        "c701f64861b9",
        "4920a3212816",
        "3378dbaf14d2",
        "497ef7043d93",
        "d152ef8ed045",
        "bfd09bd69069",
    ],
    "local": [
        "395a6c280f36",
        "47a3e26952eb",
        "8135db12b211",
        "0b298e955841",
        "928aa5c9638e",
        "18fb9ac20d0d",
    ],
    "global": [
        "75b26963dbf4",
        "8c3962911852",
        "d0710b54ded8",
        "465047b38d94",
        "565533c318d7",
        "f43ef5fd5c4b",
    ],
    "half windows": [
        "984d920636d6",
        "679108ea38fe",
    ],
}


def paths(k, n, f):
    """Dancers who wander in steps of 1/64 m, upright: numbers that every machine has exactly."""
    rng = np.random.default_rng(k)
    root = np.zeros((n, f, 3))
    root[..., 1] = 0.875
    root[..., ::2] = rng.integers(-3, 4, (n, f, 2)).cumsum(1) / 64
    root[..., 0] += np.arange(n)[:, None] / 8
    contact = rng.integers(0, 2, (n, f, 4))
    pose = torch.eye(3).expand(n, f, 24, 3, 3)
    return pack(torch.tensor(contact).float(), torch.tensor(root).float(), pose)


def music(k, f, songs):
    return torch.tensor(
        np.random.default_rng(1000 + k).integers(0, 256, (songs, f, 35)) / 16
    ).float()


def groups():
    for k, (n, f, kind, songs) in enumerate(GROUPS):
        M = music(k, f, songs)
        yield DanceTake(f"g{k}", paths(k, n, f), kind, M=M[0], M_other=M[1:])


def solos():
    for k, (f, kind, songs) in enumerate(SOLOS, 50):
        M = music(k, f, songs)
        genre = GENRES[(k - 50) % 3]
        yield DanceTake(f"s{k}", paths(k, 1, f), kind, M=M[0], M_other=M[1:], genre=genre)


def digest(*tensors):
    whole = sha256()
    for tensor in tensors:
        whole.update(np.ascontiguousarray(tensor.numpy()).tobytes())
    return whole.hexdigest()[:12]


def samplers():
    change = Augmentation(mirror=0.5, music=True)
    takes = list(groups())
    yield "tcdiffpp", WindowSampler(takes, GroupCut(), augment=change, swaps=0.3, **PACKAGED)
    alone = [solo for take in takes for solo in take.solos(centred=True)]
    yield "edge", WindowSampler(alone, GroupCut(), augment=change, swaps=0.3, **PACKAGED)
    change = Augmentation(mirror=0.5, music=True, any_song=0.5)
    for name, cut in (
        ("local", SoloCut(64, GENRES)),
        ("global", PrimitiveCut(Layout(256, 64), GENRES)),
    ):
        yield name, WindowSampler(long_enough(list(solos()), cut), cut, augment=change, **PACKAGED)


def test_batches_are_those_of_the_packaged_models():
    made = {name: [digest(*windows.batch(k)[:3]) for k in range(6)] for name, windows in samplers()}
    made["half windows"] = [
        digest(*half_windows(windows))
        for name, windows in samplers()
        if name in ("local", "global")
    ]
    assert made == FOUND


@pytest.mark.parametrize("option", [{"seed": 1}, {"real": 0.9}, {"swaps": 0.0}])
def test_and_would_not_be_with_another_recipe(option):
    change = Augmentation(mirror=0.5, music=True)
    other = WindowSampler(
        list(groups()), GroupCut(), augment=change, **{"swaps": 0.3} | PACKAGED | option
    )
    assert [digest(*other.batch(k)[:3]) for k in range(6)] != FOUND["tcdiffpp"]
