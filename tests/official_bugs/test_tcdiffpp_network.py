"""What the released TCDiff++ network gets wrong; each test fails on that behaviour."""

import random

import pytest
import torch
from einops import rearrange

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.motion.order import swap_mode
from dancediff.papers.tcdiffpp.group_dance_decoder import DancerPositioning
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.papers.tcdiffpp.sequence_decoder import token_frames


def network_inputs(x):
    x_t, t, M, S = x
    return x_t, t, Conditions(M, S)


def make():
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32, "fusion_hidden": 48}
    return TCDiffPP(TCDiffPPConfig(**sizes)).eval()


def inputs(b=2, n=3, f=12):
    torch.manual_seed(1)
    x_t, M = torch.randn(b, n, f, 151), torch.randn(b, f, 35)
    return x_t, torch.randint(1000, (b,)), M, torch.arange(n).expand(b, n)


def test_swap_mode_changes_output():
    """Released: the order is computed, then a constant is used."""
    model, (x_t, t, M, S) = make(), inputs()
    for k in range(2):
        other = S.clone()
        other[:, [k, k + 1]] = S[:, [k + 1, k]]
        assert (
            model(x_t, t, Conditions(M, other))[1] - model(x_t, t, Conditions(M, S))[1]
        ).abs().amax((1, 2, 3)).min() > 1e-3


def test_order_uses_first_frame():
    """Released: ranks come from the last frame, so that the order at the end is always 0, 1, 2."""
    x_first, x_last = torch.tensor([-1.0, 0.0, 1.0]), torch.tensor([1.0, 0.0, -1.0])
    assert swap_mode(x_first, x_last).tolist() == [2, 1, 0]


def test_codes_follow_axes_not_layout():
    """Released: codes are laid out dancer by dancer on tokens that run frame by frame."""
    n, f = 3, 150
    frames = rearrange(token_frames(torch.zeros(1, n, f, 1)), "(f n) -> n f", n=n)
    assert torch.equal(frames, torch.arange(f).expand(n, f))  # all 450 right; released: 4
    codes = DancerPositioning(5, 8)(torch.zeros(1, n, f, 8))
    assert (codes == codes[:, :, :1]).all()  # a dancer is the same dancer throughout


@pytest.mark.parametrize("extensions", [(), ("ssd",)])
def test_music_still_comes_in_beside_the_state_space_model(extensions):
    """Released: the fast path of the state space model silently drops the music."""
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "fusion_hidden": 48}
    model, (x_t, t, M, S) = build(TCDiffPP, TCDiffPPConfig(**sizes), extensions), inputs()
    layer = model.decoder.sequence_decoder.layers[0]
    for film in layer.films:  # music reaches FiLM too; here only attention may carry it
        torch.nn.init.zeros_(film.scale_and_shift[1].weight)
    assert (
        model(x_t, t, Conditions(-M, S))[1] - model(x_t, t, Conditions(M, S))[1]
    ).abs().max() > 1e-4


def test_dancers_do_not_share_a_memory():
    """Released: one state runs through dancer 0, 1, 2, 0, 1, 2, ... as if they were one stream."""
    layer = make().decoder.sequence_decoder.layers[0]
    seen = []
    layer.ssm.register_forward_hook(lambda block, args, out: seen.append((args[0], out)))
    layer.blocks = lambda *args: (lambda x: 0 * x,) * 3  # what follows the attention sees h alone
    h = torch.randn(2, 3, 12, 16)
    changed = h.clone()
    changed[1, 2, 5] += 1
    given = torch.randn(2, 5, 16), torch.randn(2, 16), torch.arange(5)
    for each in (h, changed):
        layer(each, *given)
    (before, heard), (after, told) = seen
    assert before.shape == (6, 12, 16)
    rows = (before != after).any(2).nonzero().tolist()
    assert rows == [[5, 5]], "row 3 b + n is dancer n of group b, frame by frame"
    assert (heard != told).flatten(1).any(1).nonzero().tolist() == [[5]]


def test_evaluation_is_deterministic():
    """Released: identities are drawn with Python's random in every forward pass."""
    model, x = make(), inputs()
    y = model(*network_inputs(x))[1]
    state = random.getstate()
    assert torch.equal(model(*network_inputs(x))[1], y)
    assert random.getstate() == state


def test_batch_of_one():
    model, (x_t, t, M, S) = make(), inputs()
    one = model(x_t[:1], t[:1], Conditions(M[:1], S[:1]))[1]
    torch.testing.assert_close(one, model(x_t, t, Conditions(M, S))[1][:1], atol=1e-5, rtol=1e-5)


def test_five_and_more_places_work():
    """Released: more than five dancers raise an error in the identity table."""
    torch.manual_seed(0)
    config = TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=48, max_dancers=7)
    x_t, t, M, S = inputs(n=7)
    assert TCDiffPP(config).denoise(x_t, t, Conditions(M, S)).shape == x_t.shape
