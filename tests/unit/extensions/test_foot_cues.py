import numpy as np
import torch

from dancediff.axes import FPS
from dancediff.data.choreographer import choreograph
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.extensions.foot_cues import NUM_CUES, NUM_MOVING, SLOW, foot_cues
from dancediff.motion.representation import TCDIFFPP, Normalizer
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.papers.tcdiffpp.footwork_adaptor import ground_velocity
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

NORM = Normalizer(-2 * torch.ones(151), 3 * torch.ones(151))
SIZES = {"d_model": 16, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 48}


def test_cues_are_forward_kinematics():
    dance, _ = choreograph(np.arange(0.2, 4, 0.5), dancers=2, seed=3, seconds=3)
    cues = foot_cues(NORM.normalize(dance.features())[None], NORM)[0]
    feet = dance.joints()[:, :, FOOT_JOINTS]
    seen, heights, v, slow = cues.split([12, 4, 12, 12], dim=-1)
    expected = (feet - dance.root[:, :, None]).flatten(-2)
    torch.testing.assert_close(seen, expected, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(heights, 5 * feet[..., 1], atol=1e-3, rtol=1e-3)
    step = FPS * feet.diff(dim=1).flatten(-2)
    torch.testing.assert_close(v[:, :-1], step, atol=1e-2, rtol=1e-3)
    assert (v[:, -1] == 0).all() and torch.equal(slow, (SLOW * v).tanh())
    assert cues.shape[-1] == NUM_CUES == NUM_MOVING + 12


def test_cues_do_not_see_where_on_the_stage_somebody_is():
    x = torch.randn(1, 2, 6, 151)
    moved = x.clone()
    moved[..., TCDIFFPP.root.start] += 0.7
    torch.testing.assert_close(foot_cues(x, NORM), foot_cues(moved, NORM), atol=1e-3, rtol=1e-3)


def test_no_gradient_goes_through():
    assert not foot_cues(torch.randn(1, 1, 4, 151, requires_grad=True), NORM).requires_grad


def test_network_and_adaptor_read_them():
    """The network changes with them, the adaptor is given those of the raw guess."""
    torch.manual_seed(0)
    model = build(TCDiffPP, TCDiffPPConfig(**SIZES), ["preconditioning", "foot_cues"])
    x_t, t = torch.randn(1, 2, 8, 151), torch.tensor([300])
    conditions = Conditions(torch.randn(1, 8, 35), torch.arange(2)[None])
    seen = []
    model.footwork_adaptor.register_forward_pre_hook(lambda _, given: seen.append(given))
    x_raw, _ = model(x_t, t, conditions)
    adapted, v = seen[0]
    assert torch.equal(adapted, x_raw) and torch.equal(v[..., :2], ground_velocity(x_raw))
    assert torch.equal(v[..., 2:], foot_cues(x_raw, model.normalizer)[..., -NUM_MOVING:])
    with torch.no_grad():
        model.parts["foot_cues"].embed_cues.weight.mul_(3)
    assert not torch.allclose(model(x_t, t, conditions)[0], x_raw)
    with torch.no_grad():
        for layer in model.footwork_adaptor.layers:
            layer.gate.weight.normal_()
    without = v.clone()
    without[..., 2:] = 0
    adaptor = model.footwork_adaptor
    assert not torch.allclose(adaptor(x_raw, v), adaptor(x_raw, without))
