"""Broken models, checkpoints, configs: only ValueError, and no memory for what is not there."""

import shutil

import pytest
import torch
from fuzzing import fuzz, mutated, num_inputs, put

from dancediff import hub
from dancediff.extensions.build import check_extensions
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.ablation_config import read_ablation
from dancediff.training.checkpoint import Checkpointer
from dancediff.training.config import TrainConfig
from dancediff.training.ema import EMA
from dancediff.training.optimizer import make_optimizer
from dancediff.training.run import MODELS, read_config, settings_of
from places import CONFIGS

SMALL = {"d_model": 8, "num_heads": 1, "num_layers": 1, "ff_dim": 8, "max_dancers": 2}


@pytest.fixture(scope="module")
def model():
    torch.manual_seed(0)
    return TCDiffPP(TCDiffPPConfig(**SMALL, fusion_hidden=8, footwork_hidden=8, num_frames=16))


@pytest.mark.filterwarnings("ignore:model folder .* is of dancediff")  # a changed number may say so
@pytest.mark.parametrize("file", ["config.json", "model.safetensors"])
def test_a_model_folder(model, file, tmp_path, record_property):
    folder = hub.save_model(model, tmp_path / "small")
    path = folder / file
    whole = path.read_bytes()
    head = len(whole) if file.endswith("json") else 8 + int.from_bytes(whole[:8], "little")

    def read(given):
        put(path, given)
        loaded = hub.load(folder).model
        assert all(value.isfinite().all() for value in loaded.state_dict().values())

    out = fuzz(read, mutated(whole, num_inputs(), head=head))
    record_property("trust", f"fuzz, model folder, {file}: {out}")
    assert out.refused > 0.3 * out.tried
    path.write_bytes(whole)
    assert fuzz(lambda given: hub.load(folder), [whole]).read == 1


def test_a_checkpoint(model, tmp_path, record_property):
    path, ema = tmp_path / "checkpoint.safetensors", EMA(model, 0.9)
    optimizer = make_optimizer(model, TrainConfig())
    checkpointer = Checkpointer(path, model, ema, optimizer, {})
    checkpointer.save(3)
    whole = path.read_bytes()

    def read(given):
        put(path, given)
        checkpointer.load()

    head = 8 + int.from_bytes(whole[:8], "little")
    out = fuzz(read, mutated(whole, num_inputs(), head=head))
    record_property("trust", f"fuzz, checkpoint: {out}")
    assert out.refused > 0.3 * out.tried


@pytest.mark.parametrize("name", ["tcdiffpp_small", "edge_small", "ablate_tiny", "ablate_lodge"])
def test_a_config(name, tmp_path, record_property):
    path = tmp_path / "a.toml"
    shutil.copy(CONFIGS / f"{name}.toml", path)
    whole = path.read_bytes()

    def read(given):
        put(path, given)
        if name.startswith("ablate"):
            return read_ablation(path)
        tables = read_config(path)
        kind, sizes = MODELS[tables["model"].pop("class", "TCDiffPP")]
        names, _ = tables["model"].pop("extensions", []), tables["model"].pop("genres", [])
        check_extensions(kind, sizes(**tables["model"]), names)
        return settings_of(tables)

    out = fuzz(read, mutated(whole, num_inputs()))
    record_property("trust", f"fuzz, config {name}.toml: {out}")
    assert out.read > 0.01 * out.tried  # a broken comment is no broken config
    assert out.refused > 0.2 * out.tried
