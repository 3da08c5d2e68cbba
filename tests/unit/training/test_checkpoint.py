import json

import pytest
import torch
from safetensors import safe_open
from torch import nn

from dancediff.extensions.build import build
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.training.checkpoint import Checkpointer, facts_of
from dancediff.training.config import TrainConfig
from dancediff.training.ema import EMA
from dancediff.training.optimizer import make_optimizer


def parts(seed=0, width=3):
    torch.manual_seed(seed)
    model = nn.Sequential(nn.Linear(2, width), nn.BatchNorm1d(width))
    optimizer = torch.optim.AdamW(model.parameters(), lr=0.1, fused=True)
    return {"model": model, "ema": EMA(model, 0.9), "optimizer": optimizer}


def steps(model, ema, optimizer, count=3):
    g = torch.Generator().manual_seed(1)
    for _ in range(count):
        optimizer.zero_grad()
        model(torch.randn(8, 2, generator=g)).square().sum().backward()
        optimizer.step()
        ema.update(model)


@pytest.fixture
def saved(tmp_path):
    old = parts()
    steps(**old)
    Checkpointer(tmp_path / "c.safetensors", **old, facts={"lr": 0.1}).save(3)
    return old, tmp_path / "c.safetensors"


def test_everything_comes_back(saved):
    old, path = saved
    new = parts(seed=9)
    assert Checkpointer(path, **new, facts={}).load() == 3
    assert new["ema"].updates == 3
    for part in (lambda p: p["model"], lambda p: p["ema"].model):
        for name, value in part(old).state_dict().items():
            assert torch.equal(part(new).state_dict()[name], value), name
    steps(**old)
    steps(**new)  # with the moments lost, these steps would differ
    assert torch.equal(old["model"][0].weight, new["model"][0].weight)
    assert torch.equal(old["ema"].model[0].weight, new["ema"].model[0].weight)


def test_file_is_plain_safetensors(saved):
    with safe_open(saved[1], "pt") as file:
        assert json.loads(file.metadata()["facts"])["config"] == {"lr": 0.1}
        kinds = {key.split(".")[0] for key in file.keys()}
    assert kinds == {"model", "ema", "optimizer"}


def test_a_failed_write_leaves_the_old_file(saved, monkeypatch):
    old, path = saved
    before = path.read_bytes()

    def half(tensors, file, meta):
        file.write_bytes(b"half")
        raise OSError("no space left")

    monkeypatch.setattr("safetensors.torch.save_file", half)
    with pytest.raises(OSError, match="no space"):
        Checkpointer(path, **old, facts={}).save(4)
    assert path.read_bytes() == before
    assert [p.name for p in path.parent.iterdir()] == [path.name]


@pytest.mark.parametrize("damage", ["cut", "empty", "other model"])
def test_what_is_no_checkpoint_is_named(saved, damage):
    _, path = saved
    if damage != "other model":
        path.write_bytes(path.read_bytes()[: 200 if damage == "cut" else 0])
    with pytest.raises(ValueError, match=r"c\.safetensors is no checkpoint"):
        Checkpointer(path, **parts(width=4 if damage == "other model" else 3), facts={}).load()


def test_other_extensions_or_genres_are_another_model(tmp_path):
    """Some extensions have no weights, and genres may change places: both went on in silence."""
    sizes = EDGEConfig(d_model=16, num_heads=2, num_layers=1, ff_dim=32, num_frames=5)

    def checkpointer(extensions, genres):
        model, config = build(EDGE, sizes, ["genre_condition", *extensions], genres), TrainConfig()
        made = make_optimizer(model, config)
        facts = facts_of(model, config, "")
        return Checkpointer(tmp_path / "c.safetensors", model, EMA(model), made, facts)

    checkpointer([], ["salsa", "waltz"]).save(1)
    with pytest.raises(ValueError, match=r"another model \(genres=\['salsa', 'waltz'\], here \['w"):
        checkpointer([], ["waltz", "salsa"]).load()
    with pytest.raises(ValueError, match=r"another model \(extensions=\['genre_condition'\], here"):
        checkpointer(["aligned_attention"], ["salsa", "waltz"]).load()
    assert checkpointer([], ["salsa", "waltz"]).load() == 1
