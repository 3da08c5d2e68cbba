"""Naive long sampling: copying at the same noise level, then cross-fading."""

from dataclasses import dataclass
from itertools import pairwise

import pytest
import roma
import torch

from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.diffusion.schedule import cosine_abar, q_sample
from dancediff.generation.all_segments import AT_ONCE
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.request import TCDiffPPRequest
from dancediff.generation.segmented_dance import naive_dance
from dancediff.motion.blend import cross_fade
from dancediff.motion.representation import Normalizer, pack, unpack
from dancediff.motion.rotation import rotation_about, slerp
from dancediff.papers.edge.naive_long_sampling import Consistency, join
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

ABAR = cosine_abar()


def rotations(*shape, seed=0):
    v = torch.randn(*shape, 3, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return roma.rotvec_to_rotmat(v)


def a_dance(frames, n=2):
    """A smooth dance in metres and 6-D rotations, (n, frames, 151)."""
    f = torch.arange(frames, dtype=torch.float64) / 30
    phase = torch.arange(n)[:, None]
    root = torch.stack([torch.sin(f + phase), 0.9 + 0 * f + 0 * phase, torch.cos(0.7 * f + phase)])
    pose = rotation_about("y", 0.5 * torch.sin(2 * f + phase))[:, :, None].expand(
        n, frames, 24, 3, 3
    )
    return pack(torch.zeros(n, frames, 4, dtype=torch.float64), root.movedim(0, -1), pose)


@pytest.mark.parametrize("overlap", [1, 75, 110, 149])
def test_after_a_step_every_overlap_agrees(overlap):
    x = torch.randn(4, 2, 150, 3)
    before = x.clone()
    held = Consistency(overlap)(x, t_next=500)
    assert torch.equal(x, before)  # the sampler's own tensor is not written to
    for i in range(1, 4):
        assert torch.equal(held[i, :, :overlap], held[i - 1, :, -overlap:])
        assert torch.equal(held[i, :, overlap:], x[i, :, overlap:])
    assert torch.equal(held[0], x[0])
    assert torch.equal(Consistency(overlap)(x, t_next=-1), x)


def test_during_sampling_both_sides_have_the_same_noise():
    seen, k = [], 3
    g = torch.Generator().manual_seed(0)

    def shrink(x_t, t):
        seen.append(x_t.clone())
        return 0.5 * x_t

    sample(
        *[shrink, (k, 1, 150, 2)],
        SamplerOptions(ABAR, "ddim", 5, eta=1.0, clamp=None),
        **{"generator": g, "pin": Consistency(75)},
    )
    first, *later = seen
    assert (first[1:, :, :75] - first[:-1, :, 75:]).abs().max() > 1  # independent noise
    for x_t in later:
        assert torch.equal(x_t[1:, :, :75], x_t[:-1, :, 75:])


def test_slerp_agrees_with_quaternions():
    R0, R1 = rotations(50, seed=1), rotations(50, seed=2)
    q0, q1 = roma.rotmat_to_unitquat(R0), roma.rotmat_to_unitquat(R1)
    for w in (0.0, 0.2, 0.5, 1.0):
        slow = roma.unitquat_slerp(q0, q1, torch.tensor([w], dtype=q0.dtype), shortest_arc=True)[0]
        fast = slerp(R0, R1, torch.full((50,), w, dtype=q0.dtype))
        torch.testing.assert_close(fast, roma.unitquat_to_rotmat(slow), atol=1e-6, rtol=0)


def test_cross_fade_goes_from_one_to_the_other():
    first, second = a_dance(75), a_dance(75) + 0.3
    second = pack(*unpack(second))  # rotations again
    faded = cross_fade(first, second)
    torch.testing.assert_close(faded[:, 0], first[:, 0])
    torch.testing.assert_close(faded[:, -1], second[:, -1])
    torch.testing.assert_close(faded[:, 37, 4:7], (first + second)[:, 37, 4:7] / 2)
    pose = unpack(faded)[2]
    torch.testing.assert_close(pose @ pose.mT, torch.eye(3).double().expand_as(pose))
    half = [unpack(x)[2][:, 37] for x in (first, faded, second)]
    arcs = [roma.rotmat_geodesic_distance(half[1], end) for end in (half[0], half[2])]
    torch.testing.assert_close(arcs[0], arcs[1])


def test_slerp_keeps_the_speed_of_a_turn_where_blending_six_numbers_would_not():
    R0, R1 = torch.eye(3), rotation_about("y", torch.tensor(3.0))
    turns = [slerp(R0, R1, torch.tensor(w)) for w in (0.0, 0.25, 0.5, 0.75, 1.0)]
    steps = [roma.rotmat_geodesic_distance(a, b).item() for a, b in pairwise(turns)]
    assert steps == pytest.approx([0.75] * 4, abs=1e-4)


@pytest.mark.parametrize(("k", "overlap"), [(1, 75), (2, 75), (9, 75), (4, 40), (4, 110), (3, 1)])
def test_segments_of_one_dance_are_joined_to_that_dance(k, overlap):
    stride = 150 - overlap
    dance = a_dance(150 + stride * (k - 1))
    x = dance.unfold(1, 150, stride).permute(1, 0, 3, 2)
    assert x.shape == (k, 2, 150, 151)
    torch.testing.assert_close(join(x, overlap), dance, atol=1e-6, rtol=0)


def test_join_leaves_no_jump_where_segments_disagree():
    x = a_dance(300).unfold(1, 150, 75).permute(1, 0, 3, 2).clone()
    x[1, ..., 4] += 0.2
    step = join(x, 75)[..., 4].diff(dim=1) - a_dance(300)[..., 4].diff(dim=1)
    assert step.abs().max() == pytest.approx(0.2 / 74, abs=1e-6)


def test_overlap_out_of_range_is_named():
    with pytest.raises(ValueError, match=r"overlap=150 must lie in 1 \.\.\. 149"):
        join(torch.zeros(2, 1, 150, 151), 150)


@dataclass
class Tune:
    duration: float = 60.0
    name: str = "tune"
    is_silent: bool = False
    peak: float = 0.5

    def features(self):
        return torch.arange(1 + 30 * self.duration)[:, None].expand(-1, 35)


class Knows(torch.nn.Module):
    """A "network" that knows one dance and reads in the music which part of it is wanted."""

    def __init__(self, dance):
        super().__init__()
        self.dance, self.calls = dance, []
        self.config = TCDiffPPConfig()
        self.normalizer = Normalizer(-3 * torch.ones(151), 3 * torch.ones(151))
        self.register_buffer("abar", ABAR)

    music_normalizer = type("Plain", (), {"normalize": staticmethod(lambda M: M)})

    def denoise(self, x_t, t, conditions):
        told = conditions.swap.tolist(), conditions.music_mask.tolist()
        self.calls.append((x_t.shape[0], int(t[0]), *told))
        starts = conditions.music[:, 0, 0].long().tolist()
        x = torch.stack([self.dance[:, start : start + 150] for start in starts])
        return self.normalizer.normalize(x.to(x_t))


def naive(model, **options):
    options = {"dancers": 2, "long_sampling": "naive"} | options
    return TCDiffPPRequest(**options).resolve(model, Tune())


@pytest.mark.parametrize("seconds", [3, 5, 7.4, 24, 40])
def test_perfect_network_gives_the_whole_dance_back(seconds):
    dance = a_dance(1500)
    model = Knows(dance).eval()
    request = naive(model, seconds=seconds, steps=3, foot_contact=False)
    x = naive_dance(model, Tune(), request)
    assert x.shape == (2, request.frames, 151)
    torch.testing.assert_close(x, dance[:, : request.frames].float(), atol=1e-5, rtol=0)


def test_long_dances_go_through_the_network_in_parts():
    model = Knows(a_dance(1800))
    naive_dance(model, Tune(), naive(model, steps=1, guidance=1.0))
    assert [b for b, *_ in model.calls] == [AT_ONCE, AT_ONCE, 23 - 2 * AT_ONCE]


def test_guidance_ramp_of_edge():
    for seconds, first in ((24, [False]), (5, [True, False])):
        for ramp in (True, False):
            model = Knows(a_dance(1000))
            request = naive(model, seconds=seconds, steps=4, guidance=2.0)
            naive_dance(model, Tune(), request, ramp=ramp)
            expected = first if ramp else [True, False]  # weight 0: only without music
            assert sorted(set(model.calls[0][3])) == sorted(expected)


def test_a_swap_is_asked_of_its_segment_only():
    model = Knows(a_dance(700))
    request = naive(model, seconds=10, steps=1, swap=[1, 0], swap_at=6, guidance=1.0)
    naive_dance(model, Tune(), request)
    assert model.calls[0][2] == [[0, 1], [1, 0], [0, 1]]


def test_tcdiffpp_without_its_long_sampling():
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 32}
    model = pipeline_of(TCDiffPP(TCDiffPPConfig(**sizes, without=("ssm",))))
    song = Tune(10.0)
    song.features = lambda: torch.randn(301, 35, generator=torch.Generator().manual_seed(0))
    options = {"dancers": 3, "steps": 2, "seconds": 8}
    naive, lgds = (model.generate(song, long_sampling=way, **options) for way in ("naive", "lgds"))
    assert naive.root.shape == lgds.root.shape == (3, 240, 3)
    assert not torch.equal(naive.root, lgds.root)
    assert naive.meta["long_sampling"] == "naive" and "pinning" in lgds.meta


def test_q_sample_levels_are_those_of_the_sampler():
    """The frames that are copied carry as much noise as those they replace."""
    x_0 = torch.zeros(2, 1, 150, 50)
    levels = []

    def denoise(x_t, t):
        levels.append((t, x_t[1, :, :75].std().item(), x_t[1, :, 75:].std().item()))
        return x_0

    g = torch.Generator().manual_seed(0)
    sample(
        denoise,
        x_0.shape,
        SamplerOptions(ABAR, "ddim", 5, eta=1.0),
        generator=g,
        pin=Consistency(75),
    )
    for t, copied, own in levels:
        expected = q_sample(x_0, t, ABAR, torch.ones_like(x_0)).mean().item()
        assert copied == pytest.approx(expected, rel=0.05)
        assert own == pytest.approx(expected, rel=0.05)
