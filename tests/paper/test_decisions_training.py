"""The numbered decisions of docs/differences.md about training, sampling and evaluation.

As in test_decisions.py: where the released code does something else, the test has it as a stand-in.
"""

import math

import pytest
import torch

from dancediff.data.windows import Batch
from dancediff.diffusion.samplers import SamplerOptions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions import ssd
from dancediff.extensions.hard_contact import hard_contact
from dancediff.generation.request import TCDiffPPRequest, default_of
from dancediff.generation.segments import SegmentPlan
from dancediff.motion.representation import Normalizer
from dancediff.nn import ssm as nn_ssm
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler
from dancediff.papers.tcdiffpp.losses import LossWeights, l_contact, l_dist, l_vel
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.ablation_config import HeldOut
from dancediff.training.adan import Adan
from dancediff.training.config import TrainConfig
from dancediff.training.objective import GroupObjective
from dancediff.training.optimizer import make_optimizer
from dancediff.training.run import read_config
from places import CONFIGS


def test_t16_a_misplaced_dancer_costs_the_papers_weight():
    """Released: compares frames of one dancer, with weight 100; a misplaced dancer is free."""
    root = torch.randn(1, 3, 9, 3)
    wrong = root.clone()
    wrong[:, 0] += 1.0
    released = 100 * (wrong - root).diff(dim=2).square().mean()
    assert released.item() < 1e-9 < LossWeights().dist * l_dist(wrong, root).item()
    assert LossWeights().dist == 0.636
    pairs = l_dist(wrong, root).item()
    assert pairs == pytest.approx(2 / 3)  # a mean: 2 of 3 pairs are wrong by 1 in each of 3 axes
    assert l_dist(wrong.repeat(1, 1, 5, 1), root.repeat(1, 1, 5, 1)).item() == pytest.approx(pairs)


def test_t17_a_sliding_root_costs_velocity():
    """Released: the change of the rotations alone."""
    x = torch.zeros(1, 1, 4, 151)
    sliding = x.clone()
    sliding[..., 4] = torch.arange(4.0)
    released = (sliding[..., 7:].diff(dim=2) - x[..., 7:].diff(dim=2)).square().mean()
    assert released == 0 and l_vel(sliding, x).item() == pytest.approx(1 / 147)


def test_t18_one_scale_for_all_clips():
    """Released: refitted for every clip, so that it does not matter where one dances."""
    clip = torch.rand(1, 2, 20, 151)
    beside = clip + 3.0
    alone = [Normalizer.fit(part).normalize(part) for part in (clip, beside)]
    torch.testing.assert_close(*alone, atol=1e-4, rtol=0)
    model = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=48))
    model.normalizer = Normalizer.fit(torch.cat([clip, beside]))
    objective = GroupObjective(model, TrainConfig())
    M, S = torch.rand(1, 20, 35), torch.arange(2)[None]
    near, far = (
        objective.drawn(model, Batch(part, M, S), number=0).batch.x[..., 4].mean()
        for part in (clip, beside)
    )
    assert far - near > 1
    assert {"normalizer.low", "normalizer.high"} <= set(model.state_dict())


def test_t19_optimiser_is_a_setting():
    model = torch.nn.Linear(3, 2)
    paper = read_config(CONFIGS / "tcdiffpp_paper.toml")["train"]
    assert isinstance(make_optimizer(model, TrainConfig()), torch.optim.AdamW)
    assert (paper["optimizer"], paper["lr"], paper["weight_decay"]) == ("adam", 5e-5, 0.0)
    assert type(make_optimizer(model, TrainConfig(**paper))) is torch.optim.Adam
    released = TrainConfig(optimizer="adan", lr=4e-4, weight_decay=0.02)
    adan = make_optimizer(model, released)
    assert isinstance(adan, Adan) and adan.param_groups[0]["weight_decay"] == 0.02
    with pytest.raises(ValueError, match="optimizer='sgd'"):
        TrainConfig(optimizer="sgd")


def long_dance(segments, overlap=75):
    """A dance whose frames are their own numbers, and a network that knows it."""
    frames = 150 + (150 - overlap) * (segments - 1)
    dance = (torch.arange(frames) / 1000)[None, :, None].expand(1, frames, 1)

    def network(x_t, t, M, S):
        start = int(M[0, 0, 0]) * (150 - overlap)
        return dance[None, :, start : start + 150]

    return dance, network


def test_t21_the_first_segment_is_kept():
    """Released: it is made, then left out, so that the dance runs 2.5 s behind its music."""
    dance, network = long_dance(4)
    music = torch.arange(4.0)[:, None, None].expand(4, 150, 35)
    sampler = LongGroupSampler(
        shape=(1, 150, 1),
        bind=lambda c: lambda x_t, t: network(x_t, t, c.music, c.swap),
        music=music,
        root_x=lambda frame: frame[:, 0],
        options=SamplerOptions(cosine_abar(), "ddim", 2, eta=1.0),
        overlap=75,
        pinning="init",
        seam="copy",
    )
    x = sampler.dance()
    torch.testing.assert_close(x, dance, atol=1e-6, rtol=0)
    segments = [network(None, 0, M[None], None)[0] for M in music]
    released = torch.cat([segments[1], *(part[:, 75:] for part in segments[2:])], dim=1)
    late = (released - dance[:, : released.shape[1]]) * 1000 / 30  # in seconds
    torch.testing.assert_close(late, torch.full_like(late, 2.5), atol=1e-3, rtol=0)


def test_t22_segments_share_half_of_their_frames():
    asked = default_of("tcdiffpp", "overlap")
    assert asked == TCDiffPPConfig.paper().num_frames // 2 == 75
    assert SegmentPlan(720, 150, overlap=30).stride == 120


def test_t25_long_dances_are_judged_at_720_frames():
    """Released: cut at 512."""
    assert HeldOut().seconds * 30 == 720
    request = TCDiffPPRequest(seconds=HeldOut().seconds)
    assert request.frames == 720 and SegmentPlan.of(request, 150).count == 9


def test_t27_contact_is_as_printed_or_a_hard_mask_in_physical_units():
    """Released: values above 0.95 after scaling; a dancer who always stands never reaches that."""
    joints = torch.zeros(1, 1, 3, 24, 3)
    joints[0, 0, :, 7, 0] = torch.arange(3.0)  # an ankle slides a metre a frame
    standing = torch.ones(1, 1, 3, 4)
    assert l_contact(joints, standing).item() > 0.05
    refitted = Normalizer.fit(standing.flatten(0, 2)).normalize(standing)  # for this clip alone
    assert l_contact(joints, (refitted > 0.95).float()).item() == 0
    printed = [l_contact(joints, share * standing).item() for share in (0.4, 0.6, 1.0)]
    assert printed == pytest.approx([share**2 * printed[2] for share in (0.4, 0.6, 1.0)])
    hard = [l_contact(joints, hard_contact(share * standing)).item() for share in (0.4, 0.6, 1.0)]
    assert hard == [0, printed[2], printed[2]]


@pytest.mark.parametrize("kind", ["mamba", "ssd"])
def test_t28_the_input_enters_by_eulers_step_and_the_state_is_float32(kind, monkeypatch):
    """The paper's section 3.4 prints the zero-order hold, which no Mamba code computes for B."""
    u = delta = B = C = torch.ones(1, 1, 1, dtype=torch.float64)
    A, none = torch.tensor([-2.0], dtype=torch.float64), torch.zeros(1, dtype=torch.float64)
    scan = nn_ssm.selective_scan if kind == "mamba" else ssd.ssd_scan
    y = scan(u, delta, A[:, None] if kind == "mamba" else A, B, C, none)
    hold = (math.exp(-2.0) - 1) / -2.0
    assert y.item() == 1.0 and hold == pytest.approx(0.4323, abs=1e-4)
    seen = []
    spy = lambda *told: seen.append({x.dtype for x in told}) or scan(*told)  # noqa: E731
    module = nn_ssm if kind == "mamba" else ssd
    monkeypatch.setattr(module, scan.__name__, spy)
    with torch.autocast("cpu", torch.bfloat16):
        block = nn_ssm.MambaBlock if kind == "mamba" else ssd.SSDBlock
        block(16)(torch.randn(1, 9, 16))
    assert seen == [{torch.float32}]
