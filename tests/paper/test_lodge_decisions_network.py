"""Decisions about Lodge's networks, one test each; those tested elsewhere are in other files.

The numbers are those of the paper's and the code's disagreements: l07 is the seventh.
"""

import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.guidance import guided, off_at_the_end
from dancediff.genre import FINEDANCE
from dancediff.motion.contact import CONTACT_HEIGHT
from dancediff.motion.skeleton import FOOT_JOINTS
from dancediff.papers.lodge.foot_refine import foot_features
from dancediff.papers.lodge.genre_discriminator import DiscriminatorConfig
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.losses import LodgeWeights

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "num_frames": 20}
SIZES |= {"style_noise": 64}


def make(**options):
    torch.manual_seed(0)
    return LocalDenoiser(LocalConfig(**SIZES | options)).eval()


def label_of(heights):
    joints = torch.zeros(1, 24, 3)
    joints[0, FOOT_JOINTS, 1] = torch.tensor(heights)
    return foot_features(joints).unflatten(-1, (4, 4, 3))[0, 0, :, 0].tolist()


def test_l06_feet_come_as_left_and_right_ankle_then_left_and_right_toe():
    for k, joint in enumerate((7, 8, 10, 11)):
        joints = torch.zeros(1, 24, 3)
        joints[0, joint, 1] = 1.0
        label = foot_features(joints).unflatten(-1, (4, 4, 3))[0, 0, :, 0]
        assert label.tolist() == [float(i != k) for i in range(4)]


def test_l07_label_is_ankle_12_and_toe_5_centimetres():
    assert CONTACT_HEIGHT == (0.12, 0.12, 0.05, 0.05)
    assert label_of([0.11, 0.11, 0.04, 0.04]) == [1, 1, 1, 1]
    assert label_of([0.13, 0.13, 0.06, 0.06]) == [0, 0, 0, 0]


def test_l08_music_is_pooled_only_if_asked():
    """Paper: downsampled by two transformer layers. Released: 1024 tokens."""
    sizes = {k: v for k, v in SIZES.items() if k not in ("num_frames", "style_noise")}
    conditions, t = Conditions(torch.randn(1, 64, 35)), torch.tensor([9])
    tokens = {}
    for asked in ({}, {"pool": 4}):
        model = GlobalDenoiser(GlobalConfig(**sizes, music_frames=64, local_frames=64, **asked))
        tokens[model.config.pool] = model.decoder.condition(t, conditions)[0].shape[1]
    assert tokens == {1: 64, 4: 16}
    assert GlobalConfig().pool == 1


def test_l10_equations_5_to_7_are_off_until_fine_tuning_and_small_then():
    names = ("jvel", "jacc", "contact")
    for weights in (LodgeWeights.coarse(), LodgeWeights.local()):
        assert not any(getattr(weights, name) for name in names)
    fine = LodgeWeights.fine_tune()
    assert all(0 < getattr(fine, name) < fine.recon for name in names)


def test_l12_genre_is_a_token_in_the_memory():
    seen = []
    model = make()
    model.decoder.norm_memory.register_forward_pre_hook(lambda module, args: seen.append(args[0]))
    token = model.style(torch.tensor([2]), torch.randn(1, 64)).detach()
    conditions = Conditions(torch.randn(1, 20, 35), style=token)
    model(torch.randn(1, 20, 139), torch.tensor([9]), conditions)
    assert seen[-1].shape == (1, 20 + 2 + 1, 16)  # music, step, style
    assert torch.equal(seen[-1][:, -1], token)


def test_l13_thirteen_primitives_in_training_as_in_sampling():
    assert GlobalConfig().layout.num_primitives == GlobalConfig().clips == 13


def test_l23_every_part_of_the_second_stage_is_for_256_frames():
    for config in (LocalConfig(), DiscriminatorConfig()):
        assert config.num_frames == 256


def test_l24_no_exaggeration_in_the_last_tenth_of_ddpm():
    model = make()
    x, M = torch.randn(1, 20, 139), torch.randn(1, 20, 35)
    style = model.style(torch.tensor([1]), torch.randn(1, 64)).detach()
    denoise = guided(model.denoise, Conditions(M, style=style), off_at_the_end(2.0))
    for t, plain in ((99, True), (100, False)):
        once = model(x, torch.tensor([t]), Conditions(M, style=style))[1]
        assert torch.allclose(denoise(x, t), once, atol=1e-6) == plain


def test_l25_sixteen_genres_in_the_papers_sizes():
    assert LocalConfig().genres == DiscriminatorConfig().genres == FINEDANCE
    assert len(FINEDANCE) == 16
