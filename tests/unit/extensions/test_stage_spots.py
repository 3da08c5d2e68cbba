import pytest
import torch

from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.stage_spots import SPREAD, stage_spots, stage_spots_hook
from dancediff.motion.representation import LODGE, Normalizer

F, STD = 64, (1 / (1 + torch.arange(64.0)[:, None]) ** 2).expand(64, LODGE.dim)
NORMALIZER = Normalizer(torch.full((LODGE.dim,), -2.0), torch.full((LODGE.dim,), 1.0))
SPOTS = torch.tensor([[0.0, 0.0], [0.5, -0.25], [0.0, 0.25]])


def travelled(x):
    """How far segments get along x and z, in metres."""
    floor = NORMALIZER.unnormalize(x)[..., LODGE.floor]
    return floor[:, -1] - floor[:, 0]


def test_segments_travel_to_their_spots_and_nothing_else_of_the_root_changes():
    hook = stage_spots_hook(SPOTS, F, NORMALIZER, STD)
    walk = torch.linspace(0, 3, F)[None, :, None].expand(2, F, LODGE.dim)
    led = hook.apply(walk, 0.5)
    assert torch.equal(led[..., LODGE.height], walk[..., LODGE.height])
    options = SamplerOptions(cosine_abar(), "ddim", 10, 0.0)
    sampled = sample(lambda x, t: walk, walk.shape, options, hooks=[hook])
    for guess in (led, sampled):
        torch.testing.assert_close(travelled(guess), SPOTS.diff(dim=0), atol=2e-3, rtol=0)
        assert guess[..., LODGE.floor].diff(dim=1).abs().max() < 0.2, "the whole way, no jump"


def test_a_segment_does_not_depend_on_those_beside_it():
    walk = torch.randn(2, F, LODGE.dim)
    both, second = stage_spots_hook(SPOTS, F, NORMALIZER, STD), SPOTS[1:]
    alone = stage_spots_hook(second, F, NORMALIZER, STD)
    torch.testing.assert_close(both.apply(walk, 0.5)[1:], alone.apply(walk[1:], 0.5))


def test_spots_lie_around_the_middle_and_differ_from_seed_to_seed():
    spots = stage_spots(0, rows=400)
    assert spots[1:].std() == pytest.approx(SPREAD, rel=0.1)
    assert spots.mean(0).norm() < 0.06
    assert spots.norm(dim=-1).max() < 4 * SPREAD
    assert not torch.equal(spots[1:3], stage_spots(1, rows=2)[1:])
