"""A small TCDiff++ for tests."""

import torch

from dancediff.extensions.build import build
from dancediff.generation.pipeline import Pipeline, pipeline_of
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 48}


def tiny_tcdiffpp(extensions=("preconditioning",), **sizes) -> Pipeline:
    """A pipeline with random weights."""
    torch.manual_seed(0)
    return pipeline_of(build(TCDiffPP, TCDiffPPConfig(**TINY | sizes), extensions).eval())
