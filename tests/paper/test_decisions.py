"""The numbered decisions of docs/differences.md about the network, one test each.

Tests that are elsewhere are named in that page. Where the released code does something else, the
test has it as a stand-in, to show that it would be noticed. 16 and up: test_decisions_training.py.
"""

import random

import pytest
import torch
from einops import rearrange

from dancediff.axes import FPS
from dancediff.data.take import DanceTake
from dancediff.data.windows import GroupCut, WindowSampler, rank_left_to_right
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import SamplerOptions
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.motion.order import swap_mode
from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import LOWER_BODY, SMPL24
from dancediff.music.features import music_features
from dancediff.nn.decoder import DecoderLayer
from dancediff.nn.ssm import MambaBlock
from dancediff.papers.tcdiffpp.footwork_adaptor import (
    ConcatSquashLinear,
    FootworkAdaptor,
    ground_velocity,
)
from dancediff.papers.tcdiffpp.group_dance_decoder import DancerPositioning
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.papers.tcdiffpp.sequence_decoder import GroupDanceLayer, token_frames
from dancediff.training.config import TrainConfig
from dancediff.training.objective import GroupObjective

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 48}


def network_inputs(x):
    x_t, t, M, S = x
    return x_t, t, Conditions(M, S)


def make(**options):
    torch.manual_seed(0)
    return TCDiffPP(TCDiffPPConfig(**SIZES | {} | options)).eval()


def inputs(b=1, n=3, f=12, m=35):
    g = torch.Generator().manual_seed(1)
    x_t, M = torch.randn(b, n, f, 151, generator=g), torch.randn(b, f, m, generator=g)
    return x_t, torch.full((b,), 300), M, torch.arange(n).expand(b, n)


def crossing(n=3, frames=170):
    """Dancers in a row who stand in the wrong order on the stage and walk to the other side."""
    x = torch.zeros(n, frames, 151)
    x[..., 4] = torch.linspace(1, -1, n)[:, None] * torch.linspace(1, -1, frames)
    x[..., 6] = torch.randn(n, 1, generator=torch.Generator().manual_seed(0))  # depth: any
    return x


def seen_in_training(model, data):
    """What a training step hands to the network: x_t, M, S."""
    seen = []
    model.register_forward_pre_hook(lambda _, args: seen.append(args))
    GroupObjective(model, TrainConfig()).losses(model, data.batch(0), 0)
    x_t, _, conditions = seen[0]
    return x_t, conditions.music, conditions.swap


def test_t01_music_is_35_numbers_at_30_fps_and_another_width_is_a_setting():
    assert TCDiffPPConfig().music_dim == TCDiffPPConfig.paper().music_dim == 35 and FPS == 30
    assert music_features(torch.randn(15360).numpy()).shape[1] == 35
    x_t, t, M, S = inputs(m=438)
    assert make(music_dim=438)(x_t, t, Conditions(M, S))[1].shape == x_t.shape
    with pytest.raises(ValueError, match="music has shape"):
        make()(x_t, t, Conditions(M, S))


def test_t02_training_sees_sorted_dancers_and_their_order():
    """Released: sorts, then trains on the dancers as they came, without S."""
    takes = [DanceTake("crossing", crossing(), M=torch.randn(170, 35))]
    x_0, _, S, *_ = WindowSampler(takes, GroupCut(), dancers_per_batch=3).batch(0)
    unsorted = takes[0].x[None, :, :150]
    assert (x_0[:, :, 0, 4].diff(dim=1) > 0).all()
    assert not (unsorted[:, :, 0, 4].diff(dim=1) > 0).any()
    model = make(cond_drop=0.0)
    x_t, _, S_seen = seen_in_training(model, WindowSampler(takes, GroupCut(), dancers_per_batch=3))
    assert torch.equal(S_seen, S) and S.tolist() == [[2, 1, 0]]
    assert x_t.shape == x_0.shape


def test_t04_sorted_by_the_lateral_axis():
    """Released: by depth (its second ground axis)."""
    x = torch.zeros(3, 5, 151)
    x[..., 4] = torch.tensor([1.0, 0.0, -1.0])[:, None]
    x[..., 6] = torch.tensor([0.0, 2.0, 1.0])[:, None]
    by_depth = x[x[:, 0, 6].argsort()]
    assert rank_left_to_right(x)[0][:, 0, 4].tolist() == [-1, 0, 1]
    assert by_depth[:, 0, 4].tolist() == [1, -1, 0]


def test_t05_swap_mode_says_something():
    """Released: sorted by the last frame, so that the order in the last frame is always 0, 1, 2."""
    x = crossing()[..., 4]
    S = swap_mode(x[:, 0], x[:, -1])
    assert S.shape == (3,) and S.tolist() == [2, 1, 0]
    by_last = x[x[:, -1].argsort()]
    assert by_last[:, -1].argsort().tolist() == [0, 1, 2]


@pytest.mark.parametrize("way", ["token", "FiLM"])
def test_t06_swap_mode_is_heard_as_token_and_through_film(way):
    """Released: a token, and always the same one."""
    model, (x_t, t, M, S) = make(), inputs()
    memory, cond = model.decoder.memory(t, Conditions(M, S))
    memory_2, cond_2 = model.decoder.memory(t, Conditions(M, S.flip(1)))
    assert torch.equal(memory[:, 1:], memory_2[:, 1:])  # the rest of the memory stays
    if way == "token":
        cond_2 = cond
    else:
        memory_2 = memory
    h = model.decoder.place(model.decoder.embed(x_t))
    y, y_2 = (
        model.decoder.sequence_decoder(h, *inputs)
        for inputs in ((memory, cond), (memory_2, cond_2))
    )
    assert (y - y_2).abs().max() > 1e-4


def test_t07_nobody_swaps_unless_asked():
    """Released: inference never passes an order. Here: the caller's order is an input."""
    model, orders = make(), []
    model.register_forward_pre_hook(lambda _, args: orders.append(args[2].swap[0].tolist()))
    for order in ((), [[2, 0, 1]]):
        LongGroupSampler(
            shape=(3, 150, 151),
            bind=GuidedDenoiser(model, 1.0, autoguidance=1.0, autoguidance_end=0.0).bind,
            music=torch.zeros(1, 150, 35),
            root_x=lambda frame: frame[:, 4],
            targets=order,
            options=SamplerOptions(model.abar, "ddim", 1, eta=1.0),
            overlap=75,
            pinning="init",
            seam="copy",
        ).dance()
    assert orders == [[0, 1, 2], [2, 0, 1]]


def test_t08_ranks_are_marked_before_the_fusion():
    """Released: after it, so that the fusion cannot know who stands where."""
    decoder, (x_t, *_) = make().decoder, inputs()
    called, marked = [], []
    decoder.dancer_positioning.register_forward_hook(lambda *_: called.append("dpe"))
    decoder.fusion_projection.register_forward_hook(lambda *_: called.append("fp"))
    decoder.fusion_projection.register_forward_pre_hook(lambda _, args: marked.append(args[0] + 0))
    for _ in range(2):
        decoder.place(decoder.embed(x_t))
        table = decoder.dancer_positioning.table
        table.data += torch.randn_like(table)
    assert called == ["dpe", "fp"] * 2
    assert (marked[1] - marked[0]).abs().amax(dim=(0, 2, 3)).min() > 0.1  # every place


def test_t09_a_rank_belongs_to_a_dancer_whatever_the_layout_of_tokens():
    """Released: codes dancer by dancer on tokens that run frame by frame."""
    n, f = 3, 150
    dpe = DancerPositioning(n, 8)
    codes = dpe(torch.zeros(1, n, f, 8))[0]
    truth = dpe.table[:, None].expand(n, f, 8)
    assert torch.equal(codes, truth)
    dancer_by_dancer = truth.reshape(1, n * f, 8)  # one dancer's frames after the other's
    released = rearrange(dancer_by_dancer, "b (f n) d -> b n f d", n=n)[0]
    right = (released == truth).all(-1).float().mean().item()
    assert right == pytest.approx(1 / 3)  # no better than chance


class Released(DecoderLayer):
    """The released code's layer: the state space model stands in the place of cross-attention."""

    def __init__(self, d_model, **sizes):
        super().__init__(d_model, **sizes)
        self.ssm = MambaBlock(d_model)

    def forward(self, h, memory, cond, memory_frames):
        attend, _, feed_forward = self.blocks(memory, token_frames(h), memory_frames)
        tokens = rearrange(h, "b n f d -> b (f n) d")
        tokens = self.run(tokens, cond, [attend, self.ssm, feed_forward])
        return rearrange(tokens, "b (f n) d -> b n f d", n=h.shape[1])


def layer(kind):
    torch.manual_seed(0)
    return kind(16, num_heads=2, ff_dim=32)


def run(layer, h=None, memory=None):
    g = torch.Generator().manual_seed(1)
    h_, memory_, cond = (torch.randn(1, *s, 16, generator=g) for s in ((3, 12), (5,), ()))
    h, memory = h_ if h is None else h, memory_ if memory is None else memory
    return layer(h, memory, cond, torch.arange(5)), h_, memory_


def test_t10_four_blocks_or_edges_three():
    """Released: three."""
    for without, blocks in (((), 4), (("ssm",), 3)):
        for part in make(without=without).decoder.sequence_decoder.layers:
            assert len(part.films) == len(part.norms) == blocks


def test_t11_the_state_space_model_is_on_and_music_comes_in_beside_it():
    """Released: off; and switched on it takes the place of attention to the music."""
    assert not TCDiffPPConfig().without and not TCDiffPPConfig.paper().without
    for kind, answers in ((GroupDanceLayer, True), (Released, False)):
        part = layer(kind)
        y, _, memory = run(part)
        assert ((run(part, memory=-memory)[0] - y).abs().max() > 1e-4) == answers, kind


def test_t12_each_dancer_has_a_state_of_its_own():
    """Released: one state runs through all dancers, 0, 1, 2, 0, 1, 2, ..."""
    for kind, shared in ((GroupDanceLayer, False), (Released, True)):
        part = layer(kind)
        torch.nn.init.zeros_(part.self_attention.out.weight)  # only the state is left to tell
        y, h, _ = run(part)
        moved = h.clone()
        moved[:, 0] = -moved[:, 0]  # LayerNorm would not see a shift
        change = (run(part, h=moved)[0] - y).abs().amax(dim=(0, 2, 3))
        assert change[0] > 0.1 and (change[1:].max() > 1e-5) == shared, kind


def test_t13_three_concat_squash_layers_of_any_width():
    for hidden in (128, 512):
        adaptor = make(footwork_hidden=hidden).footwork_adaptor
        assert [type(part) for part in adaptor.layers] == [ConcatSquashLinear] * 3
        widths = [part.linear.weight.shape for part in adaptor.layers]
        assert widths == [(hidden, 151), (hidden, hidden), (151, hidden)]
        assert {part.gate.in_features for part in adaptor.layers} == {2}


def test_t14_the_spine_is_no_leg():
    """Released: joint 3, the lowest of the spine, is adapted, too."""
    assert sorted(LOWER_BODY) == [1, 2, 4, 5, 7, 8, 10, 11] and SMPL24.names[3] == "belly"
    x = torch.randn(1, 2, 5, 151)
    adaptor = FootworkAdaptor(16)
    assert adaptor.channels.tolist() == TCDIFFPP.joint_channels(LOWER_BODY)
    for joints, changed in ((LOWER_BODY, False), ((*LOWER_BODY, 3), True)):
        adaptor.channels = torch.tensor(TCDIFFPP.joint_channels(joints))
        belly = (adaptor(x, ground_velocity(x)) - x)[..., TCDIFFPP.joint_channels([3])]
        assert (belly.abs().max() > 0) == changed


def test_t24_every_rank_has_a_vector():
    """The paper prints one number for each dancer, the same in all channels."""
    table = make(d_model=64, num_heads=4).decoder.dancer_positioning.table
    assert table.shape == (5, 64)
    assert torch.linalg.matrix_rank(table) == 5
    scalars = torch.randn(5, 1).expand(5, 64)
    assert torch.linalg.matrix_rank(scalars) == 1


def test_t29_ranks_are_not_drawn_when_dancing():
    """Released: identities are drawn in every call, here too."""
    model, x = make(), inputs()
    codes = model.decoder.dancer_positioning(torch.zeros(1, 3, 2, 16))
    assert torch.equal(codes, model.decoder.dancer_positioning(torch.zeros(1, 3, 2, 16)))
    assert torch.equal(model(*network_inputs(x))[1], model(*network_inputs(x))[1])
    draw = random.Random(0)
    drawn = [model.decoder.dancer_positioning.table[draw.sample(range(5), 3)] for _ in range(2)]
    assert not torch.equal(*drawn)
