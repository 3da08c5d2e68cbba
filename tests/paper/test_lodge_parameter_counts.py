"""Weights of Lodge's published sizes, worked out by hand.

Nothing here is read off the modules but what is compared.
"""

import torch

from dancediff.extensions.build import build
from dancediff.papers.lodge.genre_discriminator import DiscriminatorConfig, GenreDiscriminator
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.model import Lodge, LodgeConfig

D, FF, MUSIC, MOTION, GENRES = 512, 1024, 35, 139, 16


def linear(into, out, bias=True):
    return into * out + out * bias


def count(make, config):
    with torch.device("meta"):
        return sum(p.numel() for p in make(config).parameters())


ATTENTION = 4 * linear(D, D)
FEED_FORWARD = linear(D, FF) + linear(FF, D)
NORM, FILM = 2 * D, linear(D, 2 * D)
LAYER = 2 * ATTENTION + FEED_FORWARD + 3 * (NORM + FILM)


def trunk(frames, music=MUSIC, layers=8):
    return (
        linear(MOTION, D)
        + linear(D, 4 * D) + linear(4 * D, D) + linear(4 * D, 2 * D)  # step
        + linear(music, D) + 2 * (ATTENTION + FEED_FORWARD + 2 * NORM)
        + NORM + 2 * linear(D, D)  # pooled music
        + frames * D + D  # no music
        + NORM + layers * LAYER
        + linear(D, MOTION)
    )  # fmt: skip


def mapping(into, out, hidden):
    return (
        linear(into, hidden)
        + linear(hidden, hidden)
        + GENRES * (linear(hidden, hidden) + linear(hidden, out))
    )


REFINE = linear(48, D) + NORM + linear(MOTION, D) + LAYER + linear(D, MOTION)
CRITIC = (
    linear(MUSIC, D)
    + linear(MOTION, D)
    + 4 * (linear(D, 3 * D, bias=False) + linear(D, D) + 512 * 512 + FEED_FORWARD + 2 * NORM)
)


def test_global_diffusion():
    assert LAYER == 4_730_368
    assert count(GlobalDenoiser, GlobalConfig()) == trunk(1024) == 47_459_979


def test_local_diffusion():
    assert mapping(256, D, D) == 8_799_232
    total = trunk(256) + mapping(256, D, D) + REFINE
    assert count(LocalDenoiser, LocalConfig()) == total == 60_765_462


def test_the_layer_is_in_the_foot_refine_block():
    """The released code has the same total: nine layers in the trunk, none in the block."""
    without = count(LocalDenoiser, LocalConfig(foot_refine=False))
    assert without == trunk(256) + mapping(256, D, D)
    assert 60_765_462 - without == REFINE > LAYER
    with torch.device("meta"):
        model = LocalDenoiser(LocalConfig())
    assert len(model.decoder.layers) == 8
    assert sum(p.numel() for p in model.foot_refine.layer.parameters()) == LAYER


def test_discriminator():
    released = count(GenreDiscriminator, DiscriminatorConfig(head_hidden=1))
    assert mapping(D, 1, 1) == 579
    assert released == CRITIC + 579 == 9_544_259
    wide = count(GenreDiscriminator, DiscriminatorConfig())
    assert wide - released == mapping(D, 1, D) - 579 == 4_735_437


def test_what_the_switches_cost():
    paper = GlobalConfig
    full = count(GlobalDenoiser, paper())
    assert count(GlobalDenoiser, paper(pool=4)) == trunk(256, music=4 * MUSIC)
    assert full - count(GlobalDenoiser, paper(music_frames=512)) == 512 * D


def test_what_extensions_cost():
    def of(*names):
        return count(lambda config: build(Lodge, config, names), LodgeConfig())

    plain, linear_guess_and_noise = of(), 2 * MOTION * D
    assert plain == 47_459_979 + 60_765_462
    assert of("style_film") == plain
    assert of("preconditioning") - plain == 2 * linear_guess_and_noise
    assert of("global_style") - plain == mapping(256, D, D)
