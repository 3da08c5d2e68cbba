"""Small Lodge models for tests."""

from types import SimpleNamespace

import torch

from dancediff.extensions.build import build
from dancediff.generation.request import LodgeRequest, default_of
from dancediff.genre import GENRES
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.model import Lodge, LodgeConfig

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "dropout": 0.0}
GLOBAL = TINY | {"music_frames": 256, "local_frames": 64}
LOCAL = TINY | {"num_frames": 64, "style_noise": 64, "genres": GENRES}
PACKAGED = ("preconditioning", "style_film", "global_style", "beat_phase", "non_local_filter")


def tiny_lodge(extensions=PACKAGED, *, first=None, second=None, frames=64):
    """Both stages, of segments of 4 x ``frames`` and ``frames``; ``first``, ``second``: sizes."""
    torch.manual_seed(0)
    first = GLOBAL | {"music_frames": 4 * frames, "local_frames": frames} | (first or {})
    second = LOCAL | {"num_frames": frames} | (second or {})
    sizes = LodgeConfig(GlobalConfig(**first), LocalConfig(**second))
    return build(Lodge, sizes, extensions).eval()


def ask(**options):
    """A request in the paper's way: hip-hop, nothing that we add, few steps."""
    paper = {name: default_of("lodge", name, "paper") for name in LodgeRequest.names()}
    few = {"genre": "hiphop", "steps": 3, "at_once": None}
    return SimpleNamespace(**paper | few | options)
