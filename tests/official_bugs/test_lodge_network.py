"""What the released Lodge network gets wrong; each test fails on that behaviour.

Where it fits in a few lines, that behaviour stands here too, to show that the test would notice.
"""

from itertools import pairwise

import pytest
import torch
from torch import nn

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import SamplerOptions, sample, sampling_times
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.lodge_stages import ExtendedLocalDenoiser
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.nn.mapping_network import MappingNetwork
from dancediff.papers.lodge.cue_guidance import CueGuidance, guided_steps
from dancediff.papers.lodge.foot_refine import FootRefine, contact_score, foot_features
from dancediff.papers.lodge.global_diffusion import GlobalConfig, global_token_frames
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.losses import l_focus, l_jacc, l_jvel

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "num_frames": 20}
SIZES |= {"style_noise": 64, "dropout": 0.0}


def network_inputs(x):
    x_t, t, M, style = x
    return x_t, t, Conditions(M, style=style)


def make(extensions=(), **options):
    torch.manual_seed(0)
    sizes = LocalConfig(**SIZES | options)
    model = ExtendedLocalDenoiser(sizes, extensions) if extensions else LocalDenoiser(sizes)
    return model.eval()


def inputs(model, b=2):
    torch.manual_seed(1)
    style = model.style(torch.arange(b), torch.randn(b, 64)).detach()
    return torch.randn(b, 20, 139), torch.full((b,), 300), torch.randn(b, 20, 35), style


class ReleasedRefine(FootRefine):
    """Its one layer was appended to another list, so none is run."""

    def forward(self, x_raw, features, steps, cond):
        return self.out(self.embed(x_raw))


@pytest.mark.parametrize("extensions", [("preconditioning",), ()])
def test_foot_refine_reacts_to_feet(extensions):
    def reacts(model):
        x = inputs(model)
        x_raw, x_hat = model(*network_inputs(x))
        model.feet = lambda x_raw: torch.rand(*x_raw.shape[:2], 48)
        other_raw, other = model(*network_inputs(x))
        assert torch.equal(other_raw, x_raw)
        return bool((other - x_hat).abs().max() > 1e-5)

    model, released = make(extensions), make(extensions)
    released.foot_refine = ReleasedRefine(16, num_heads=2, ff_dim=32)
    assert reacts(model)
    assert not reacts(released)


def released_label(height):
    """Thresholds for a floor at -1.2 m, while the data stand at 0."""
    return height <= height.new_tensor([-1.188, -1.188, -1.15, -1.15])


def test_floor_is_where_the_data_have_it():
    joints = torch.zeros(10, 24, 3)
    joints[:, FOOT_JOINTS, 1] = 0.03
    joints[5:, FOOT_JOINTS, 1] = 0.6  # a jump
    label = foot_features(joints).unflatten(-1, (4, 4, 3))[:, 0, :, 0]
    assert label[:5].all() and not label[5:].any()
    assert not released_label(joints[:, FOOT_JOINTS, 1]).any()


def test_height_counts_in_the_contact_score():
    still = torch.zeros(4)
    planted, lifted = contact_score(still, still), contact_score(still + 0.3, still)
    assert (planted > 0.9).all() and (lifted < 0.01).all()
    low = -1.12  # a negative threshold: a lifted foot counts more than a planted one
    released = torch.sigmoid(5 * (low - torch.tensor([0.0, 0.3])) / low)
    assert released[0] == pytest.approx(0.993, abs=1e-3) and released[1] > released[0]


def released_guided_steps(times, soft):
    """DDIM: the diffusion step, 999 ... 19, is compared with a share of 50."""
    return sum(t > 50 * (1 - soft) for t in times[:-2])


def test_soft_strength_is_monotone_in_guided_steps():
    times, strengths = sampling_times("ddim", 50), (0, 0.25, 0.5, 0.75, 1)

    def means_a_share(count):
        counts = [count(times, s) for s in strengths]
        return counts[0] == 0 and all(b > a for a, b in pairwise(counts))

    assert means_a_share(guided_steps)
    assert not means_a_share(released_guided_steps)
    assert [released_guided_steps(times, s) for s in strengths] == [48, 49, 49, 49, 49]


def test_soft_strength_changes_a_ddim_dance():
    def dance(count, soft):
        cues = one_segment(soft)
        if count is not guided_steps:
            cues._reached = set(cues.times[1 : count(cues.times, soft) + 1])
        g = torch.Generator().manual_seed(0)
        return sample(
            lambda x, t: 0.9 * x,
            (1, 20, 139),
            SamplerOptions(cosine_abar(), "ddim", 50, eta=1.0),
            pin=cues,
            generator=g,
        )

    def inert(count):
        return torch.equal(dance(count, 0.25), dance(count, 0.75))

    assert not inert(guided_steps)
    assert inert(released_guided_steps)


def one_segment(soft=1.0):
    hard, middle = torch.zeros(2, 1, 20, dtype=torch.bool)
    hard[:, :4] = hard[:, -4:] = True
    middle[:, 8:12] = True
    g = torch.Generator().manual_seed(5)
    return CueGuidance(
        torch.full((1, 20, 139), 0.5),
        hard,
        middle,
        cosine_abar(),
        sampling_times("ddim", 50),
        soft,
        generators=g,
    )


def test_batch_of_one():
    """Released: a song of one segment ends in a missing argument."""
    model, cues = make(), one_segment()
    x_t, _, M, style = inputs(model, b=1)
    x = sample(
        lambda x, t: model(x, torch.full((1,), t), Conditions(M, style=style))[1],
        x_t.shape,
        SamplerOptions(cosine_abar(), "ddim", 50, eta=1.0),
        pin=cues,
    )
    assert torch.equal(x[cues.hard], cues.y[cues.hard]) and x.isfinite().all()


def test_verdicts_are_not_functions_of_one_number():
    """Released: the mapping before the 16 verdicts is one number wide."""

    def rank(hidden):
        torch.manual_seed(0)
        mapping = MappingNetwork(32, 1, num_genres=16, hidden=hidden).double()
        x = torch.randn(1, 32, dtype=torch.float64)
        slopes = torch.autograd.functional.jacobian(mapping, x).reshape(16, 32)
        return int(torch.linalg.matrix_rank(slopes))

    assert rank(hidden=32) > 8
    assert rank(hidden=1) == 1


def test_evaluation_is_deterministic():
    """Released: the style's noise is drawn in every forward pass."""
    model = make()
    x = inputs(model)
    state = torch.get_rng_state()
    assert torch.equal(model(*network_inputs(x))[1], model(*network_inputs(x))[1])
    assert torch.equal(torch.get_rng_state(), state)


def test_other_genres_are_pushed_away():
    """Released: the term for another genre has the sign of the one for the genre itself."""

    def wants(loss):
        made, other = torch.zeros(2, requires_grad=True), torch.zeros(2, requires_grad=True)
        loss(made, other).backward()
        return float(made.grad[0]) < 0, float(other.grad[0]) < 0

    assert wants(l_focus) == (True, False)
    assert wants(lambda made, other: 0.5 * (-made - other).mean()) == (True, True)


def test_root_acceleration_is_an_acceleration():
    """Released: "acceleration" is the velocity once more."""
    drift = torch.arange(6.0)[:, None, None] * torch.tensor([0.01, 0.0, 0.0])
    assert l_jacc(drift, torch.zeros_like(drift)) < 1e-6
    assert l_jvel(drift, torch.zeros_like(drift)) > 0.01


def test_a_primitive_stands_beside_its_own_music():
    """Released: token 103 sits at the music of frame 103, though it is danced at 1023."""
    frames, released = global_token_frames(GlobalConfig()), torch.arange(104)
    ends = torch.arange(256.0, 1025, 256)
    last = frames.reshape(13, 8)[[3, 6, 9, 12]].amax(1)
    assert ((ends - last).abs() <= 4).all()
    assert (ends - released.reshape(13, 8)[[3, 6, 9, 12]].amax(1)).abs().min() > 200


def test_local_stage_refuses_a_length_it_cannot_do():
    """Released: the fine-tuning config asks for 1024 frames of a network for 256."""
    assert LocalConfig().num_frames == 256
    model = make()
    _, t, _, style = inputs(model)
    with pytest.raises(ValueError, match=r"x_t has shape \(2, 80, 139\); expected \(2, 20, 139\)"):
        model(torch.randn(2, 80, 139), t, Conditions(torch.randn(2, 80, 35), style=style))


def test_no_layer_is_lost():
    """Every layer that has weights is run: each of them gets a gradient."""
    model = make().train()
    model(*network_inputs(inputs(model)))[1].square().sum().backward()
    unused = [
        name
        for name, module in model.named_modules()
        if isinstance(module, nn.Linear) and module.weight.grad is None and "style" not in name
    ]
    assert unused == []
