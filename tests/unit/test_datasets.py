"""Windows of prepared takes: cut right, masked right, and nothing of validation in training."""

import numpy as np
import pytest
import torch
from test_packed import Made
from test_prepare import tiny
from torch.utils.data import DataLoader

from dancediff.data.augment import rotate_features
from dancediff.data.datasets import Augmentation, GroupDanceDataset, LongDanceDataset
from dancediff.data.prepare import prepare
from dancediff.data.prepared import PreparedData
from dancediff.data.take import Job
from dancediff.data.windows import rank_left_to_right
from dancediff.diffusion.conditions import Conditions
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE

SHAPES = {  # name: dancers, frames, split
    "a": (1, 200, "train"),
    "b": (3, 180, "train"),
    "c": (5, 150, "train"),
    "d": (6, 300, "train"),  # too many
    "e": (2, 149, "train"),  # too short
    "long": (1, 1100, "train"),
    "v": (2, 240, "val"),
    "w": (1, 600, "val"),
}


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("prepared")
    jobs = []
    for seed, (name, (n, frames, split)) in enumerate(SHAPES.items()):
        take = tiny(name, seed, n=n, frames=frames, split=split)
        more = {"M_other": torch.randn(2, frames, 35)} if name == "b" else {}
        jobs.append(Job(name, Made(take, genre={"a": "waltz", "w": "jive"}.get(name), **more)))
    jobs.append(Job("mute", Made(tiny("mute", 99, frames=300), M=None, music="none")))
    prepare(jobs, folder, progress=False)
    return PreparedData(folder)


def test_windows_are_where_they_should_be(data):
    windows = GroupDanceDataset(data)
    assert windows.names() == ["a", "b", "c", "long"]
    assert sorted(windows.left_out) == ["d", "e", "mute"]
    counts = dict(zip(*np.unique(windows.windows[:, 0], return_counts=True), strict=True))
    expected = [1 + (SHAPES[name][1] - 150) // 15 for name in ("a", "b", "c", "long")]
    assert list(counts.values()) == expected and len(windows) == sum(expected)
    for k in range(len(windows)):
        take, start = windows.windows[k]
        motion = windows.packed.motion(take)[:, start : start + 150]
        item = windows[k]
        x, S = rank_left_to_right(motion)
        n = len(x)
        assert torch.equal(item["x"][:n], x) and torch.equal(item["S"][:n], S)
        assert torch.equal(item["M"], windows.packed.music(take)[0, start : start + 150])


def test_absent_dancers_are_zero_and_masked(data):
    windows = GroupDanceDataset(data)
    sizes = set()
    for item in windows:
        n = int(item["present"].sum())
        sizes.add(n)
        assert item["x"].shape == (5, 150, 151) and item["present"].tolist() == [True] * n + [
            False
        ] * (5 - n)
        assert not item["x"][n:].any() and item["x"][:n].any()
        assert sorted(item["S"].tolist()) == list(range(5)) and item["S"][n:].tolist() == list(
            range(n, 5)
        )
        assert (item["x"][:n, 0, 4].diff() > 0).all()
    assert sizes == {1, 3, 5}
    batch = next(iter(DataLoader(windows, batch_size=8, shuffle=True)))
    assert batch["x"].shape == (8, 5, 150, 151) and batch["S"].shape == batch["present"].shape == (
        8,
        5,
    )


def test_the_model_takes_a_batch(data):
    from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

    model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=32))
    batch = next(iter(DataLoader(GroupDanceDataset(data), batch_size=3, shuffle=True)))
    t = torch.tensor([10, 500, 900])
    _, x_hat = model(batch["x"], t, Conditions(batch["M"], batch["S"]))
    assert x_hat.shape == batch["x"].shape


def test_nothing_of_validation_is_in_training(data):
    """The leakage test: by take, by group, and by the frames themselves."""
    train, val = GroupDanceDataset(data), GroupDanceDataset(data, "val", stride=150)
    assert not set(train.names()) & set(val.names())
    groups = [{g for name in d.names() for g in data.by_name[name].groups} for d in (train, val)]
    assert groups[0] and groups[1] and not groups[0] & groups[1]
    seen = torch.cat([item["x"][item["present"]][:, ::15, 4:7].flatten(0, 1) for item in train])
    for item in val:
        frames = item["x"][item["present"]][..., 4:7].flatten(0, 1)
        assert torch.cdist(frames, seen).min() > 1e-4
    for item in train:  # and the test would notice
        assert torch.cdist(item["x"][0, ::15, 4:7], seen).min() == 0
        break


def test_augmentation_follows_from_seed_epoch_and_window(data):
    change = Augmentation(mirror=0.5, rotate=0.5, music=True)
    a, b = (GroupDanceDataset(data, augmentation=change, seed=1) for _ in range(2))
    order = np.random.default_rng(0).permutation(len(a))
    assert all(torch.equal(a[int(k)]["x"], b[int(k)]["x"]) for k in order)
    plain = GroupDanceDataset(data)
    differs = [not torch.equal(a[k]["x"], plain[k]["x"]) for k in range(len(a))]
    assert all(differs)
    b.set_epoch(1)
    assert not any(torch.equal(a[k]["x"], b[k]["x"]) for k in range(len(a)))
    other = GroupDanceDataset(data, augmentation=change, seed=2)
    assert not torch.equal(a[0]["x"], other[0]["x"])


def test_mirrored_and_turned_before_ranking(data):
    windows = GroupDanceDataset(data, augmentation=Augmentation(mirror=1.0))
    turned = GroupDanceDataset(data, augmentation=Augmentation(rotate=np.pi), seed=3)
    plain = GroupDanceDataset(data)
    for k in range(len(plain)):
        n = int(plain[k]["present"].sum())
        x = plain[k]["x"][:n]
        assert torch.equal(windows[k]["x"][:n], mirror_features(x).flip(0))
        y = turned[k]["x"][:n]
        assert (y[:, 0, 4].diff() > 0).all()
        ends = y[turned[k]["S"][:n], -1, 4]
        assert (ends.diff() >= 0).all()
        # a turn: distances stay, and so do heights and contacts
        order = torch.cdist(rotate_features(x, 0.0)[:, 0, 4:7], x[:, 0, 4:7])
        assert torch.allclose(
            torch.cdist(y[:, 0, 4:7], y[:, 0, 4:7]).sort().values.sort(0).values,
            order.sort().values.sort(0).values,
            atol=1e-4,
        )
        assert torch.allclose(y[..., 5].sort(0).values, x[..., 5].sort(0).values)


def test_music_augmentation_plays_the_songs_of_the_take(data):
    windows = GroupDanceDataset(data, augmentation=Augmentation(music=True))
    k = int(np.flatnonzero(windows.windows[:, 0] == 1)[0])
    songs = windows.packed.music(1)[:, :150]
    heard = set()
    for epoch in range(20):
        windows.set_epoch(epoch)
        M = windows[k]["M"]
        heard |= {s for s in range(3) if torch.equal(songs[s], M)}
    assert heard == {0, 1, 2}


@pytest.mark.parametrize(("name", "value"), [("mirror", 2), ("rotate", -1), ("rotate", 4)])
def test_impossible_augmentation_is_named(name, value):
    with pytest.raises(ValueError, match=f"{name}={value}"):
        Augmentation(**{name: value})


def test_short_takes_serve_the_local_stage_only(data):
    whole = LongDanceDataset(data, stage="global")
    local = LongDanceDataset(data, stage="local")
    assert whole.names() == ["long"] and local.names() == ["long"]
    assert {"a", "b", "mute"} <= set(whole.left_out)
    assert whole[0]["x"].shape == (1024, 139) and local[0]["M"].shape == (256, 35)
    half = {s: LongDanceDataset(data, stage=s, lengths=(512, 128)) for s in ("global", "local")}
    assert half["global"].names() == ["long"] and half["local"].names() == ["a", "long"]
    val = LongDanceDataset(data, "val", stage="global", lengths=(512, 128))
    assert val.names() == ["w"] and len(val) == 1 + (600 - 512) // 32
    assert not set(val.names()) & set(whole.names())


def test_long_windows_hold_the_139_numbers_and_the_genre(data):
    windows = LongDanceDataset(data, stage="local", lengths=(512, 128))
    item = windows[1]
    motion = windows.packed.motion(0)[0, 32:160]
    assert LODGE.dim == 139 and torch.equal(item["x"], motion[:, :139])
    assert windows.genres == ["jive", "waltz"] and item["genre"] == 1
    assert windows[len(windows) - 1]["genre"] == -1
    assert LongDanceDataset(data, "val", lengths=(512, 128))[0]["genre"] == 0


def test_dancers_of_groups_as_solos(data):
    windows = LongDanceDataset(data, lengths=(512, 128), groups=True)
    assert {"b", "c", "d", "e"} <= set(windows.names())
    take = windows.names().index("d")
    k = int(np.flatnonzero(windows.windows[:, 0] == take)[0])
    drawn = set()
    for epoch in range(40):
        windows.set_epoch(epoch)
        dancers = windows.packed.motion(take)[:, :128, :139]
        drawn |= {i for i in range(6) if torch.equal(windows[k]["x"], dancers[i])}
    assert drawn == set(range(6))


@pytest.mark.parametrize(
    ("options", "words"),
    [({"stage": "middle"}, "stage='middle'"), ({"lengths": (128, 512)}, r"lengths=\(128, 512\)")],
)
def test_bad_arguments(data, options, words):
    with pytest.raises(ValueError, match=words):
        LongDanceDataset(data, **options)


def test_an_empty_split_is_an_empty_set(data):
    windows = GroupDanceDataset(data, "test")
    assert len(windows) == 0 and windows.names() == []
    with pytest.raises(IndexError):
        windows[0]
    with pytest.raises(ValueError, match="stride=0"):
        GroupDanceDataset(data, stride=0)
