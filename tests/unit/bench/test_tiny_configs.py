"""The nine configs of the bench: every system has one, and all are about as large."""

import pytest
import torch

from dancediff.extensions.build import NETWORKS, build
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.model import LodgeConfig
from dancediff.training.tables import read_training
from places import CONFIGS

PATHS = [path for path in sorted(CONFIGS.glob("*_tiny.toml")) if path.stem != "ablate_tiny"]


def model_of(path):
    """The network of a config, without its values."""
    tables = read_training(path)
    sizes = dict(tables["model"])
    kind, names = sizes.pop("class", "TCDiffPP"), sizes.pop("extensions", ())
    model_class, config_class = NETWORKS[kind]
    if config_class is LodgeConfig:
        sizes = {
            "global_stage": GlobalConfig(**tables["global_stage"]),
            "local_stage": LocalConfig(**tables["local_stage"]),
        }
    with torch.device("meta"):
        return kind, build(model_class, config_class(**sizes), extensions=tuple(names))


def test_every_system_has_one():
    assert {read_training(path)["model"].get("class", "TCDiffPP") for path in PATHS} == set(
        NETWORKS
    )


@pytest.mark.parametrize("path", PATHS, ids=lambda path: path.stem)
def test_it_has_about_a_million_weights(path):
    kind, model = model_of(path)
    assert kind.lower() == path.stem.removesuffix("_tiny")
    assert 0.8e6 < sum(p.numel() for p in model.parameters()) < 1.2e6
