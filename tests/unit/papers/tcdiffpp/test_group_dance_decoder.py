import pytest
import torch
from torch import nn

from dancediff.diffusion.conditions import Conditions
from dancediff.papers.tcdiffpp.group_dance_decoder import GroupDanceDecoder
from dancediff.papers.tcdiffpp.model import TCDiffPPConfig


def network_inputs(x):
    x_t, t, M, S = x
    return x_t, t, Conditions(M, S)


def make(**options):
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "num_layers": 2, "ff_dim": 32, "fusion_hidden": 48}
    return GroupDanceDecoder(TCDiffPPConfig(**sizes | {"num_frames": 20} | options))


def inputs(b=2, n=3, f=20):
    torch.manual_seed(1)
    x_t, M = torch.randn(b, n, f, 151), torch.randn(b, f, 35)
    return x_t, torch.randint(1000, (b,)), M, torch.arange(n).expand(b, n)


@pytest.mark.parametrize("n, f", [(1, 20), (3, 20), (5, 20), (3, 7), (2, 1)])
def test_any_group_size_and_length(n, f):
    assert make()(*network_inputs(inputs(n=n, f=f))).shape == (2, n, f, 151)


@pytest.mark.parametrize("dropout", [0.0, 0.3])
def test_all_dropout_is_that_of_the_config(dropout):
    rates = [part.p for part in make(dropout=dropout).modules() if isinstance(part, nn.Dropout)]
    assert set(rates) == {dropout}
    assert len(rates) == 7  # of two layers two each; of the music two layers, and one more


@pytest.mark.parametrize("n", [1, 3, 5])
def test_right_before_a_fusion_without_a_residual_positioning_is_a_bias(n):
    """What it would be worth for one group size: its product with W_1, added to b_1."""
    decoder, (x_t, t, M, S) = make(), inputs(n=n)
    bare = make(without=("dancer_positioning",))
    bare.load_state_dict(decoder.state_dict(), strict=False)
    into, table = bare.fusion_projection.into, decoder.dancer_positioning.table.data.clone()
    table[n:] = 0  # whoever is absent is not marked
    into.bias.data += into.weight.data @ table.flatten()
    given = network_inputs((x_t, t, M, S))
    with torch.no_grad():
        torch.testing.assert_close(bare(*given), decoder(*given), atol=1e-4, rtol=0)
        bare.load_state_dict(decoder.state_dict(), strict=False)
        assert (bare(*given) - decoder(*given)).abs().max() > 1e-3


def test_swap_mode_changes_output():
    decoder, (x_t, t, M, S) = make(), inputs()
    assert (
        decoder(x_t, t, Conditions(M, S.flip(1))) - decoder(x_t, t, Conditions(M, S))
    ).abs().max() > 1e-3


def test_without_swap_mode_it_does_not():
    decoder, (x_t, t, M, S) = make(without=("swap_mode",)), inputs()
    assert torch.equal(decoder(x_t, t, Conditions(M, S.flip(1))), decoder(x_t, t, Conditions(M, S)))


def test_dropped_music_is_not_heard():
    decoder, (x_t, t, M, S) = make(), inputs()
    keep = torch.tensor([True, False])
    y, other = (
        decoder(x_t, t, Conditions(M, S, music_mask=keep)),
        decoder(x_t, t, Conditions(-M, S, music_mask=keep)),
    )
    assert torch.equal(y[1], other[1])
    assert (y[0] - other[0]).abs().max() > 1e-3
    torch.testing.assert_close(y[0], decoder(x_t, t, Conditions(M, S))[0], atol=1e-5, rtol=1e-5)
    assert (y[1] - decoder(x_t, t, Conditions(M, S))[1]).abs().max() > 1e-3


def test_step_changes_output():
    decoder, (x_t, t, M, S) = make(), inputs()
    assert (
        decoder(x_t, 999 - t, Conditions(M, S)) - decoder(x_t, t, Conditions(M, S))
    ).abs().max() > 1e-3


def test_samples_of_a_batch_do_not_meet():
    decoder, (x_t, t, M, S) = make(), inputs(b=3)
    one = decoder(x_t[1:2], t[1:2], Conditions(M[1:2], S[1:2]))
    torch.testing.assert_close(one[0], decoder(x_t, t, Conditions(M, S))[1], atol=1e-5, rtol=1e-5)


def test_every_dancer_sees_every_dancer_and_frame():
    decoder, (x_t, t, M, S) = make(), inputs()
    x_t.requires_grad_()
    decoder(x_t, t, Conditions(M, S))[0, 0, 0].sum().backward()
    assert (x_t.grad[0].abs().amax(-1) > 0).all()


def test_memory_is_swap_music_step():
    decoder, (_, t, M, S) = make(), inputs()
    memory, cond = decoder.memory(t, Conditions(M, S))
    assert memory.shape == (2, 1 + 20 + 2, 16) and cond.shape == (2, 16)
    torch.testing.assert_close(memory[:, 0], decoder.swap_mode(S))
    torch.testing.assert_close(memory[:, 1:21], decoder.music(M))
    step, tokens = decoder.timestep(t)
    torch.testing.assert_close(memory[:, 21:], tokens)
    pooled = decoder.pooled_music(decoder.music(M).mean(1))
    torch.testing.assert_close(cond, step + pooled + decoder.swap_mode(S))


@pytest.mark.parametrize(
    "name, bad",
    [
        ("x_t", {"x_t": torch.zeros(2, 6, 20, 151)}),
        ("x_t", {"x_t": torch.zeros(2, 3, 21, 151)}),
        ("x_t", {"x_t": torch.zeros(2, 3, 20, 139)}),
        ("x_t", {"x_t": torch.zeros(3, 20, 151)}),
        ("t", {"t": torch.zeros(3, dtype=torch.long)}),
        ("t", {"t": 3}),
        ("music", {"M": torch.zeros(2, 19, 35)}),
        ("swap", {"S": torch.zeros(2, 2, dtype=torch.long)}),
        ("swap", {"S": None}),
    ],
)
def test_wrong_shapes_are_named(name, bad):
    x = dict(zip(("x_t", "t", "M", "S"), inputs(), strict=True)) | bad
    with pytest.raises(ValueError, match=f"{name} has shape"):
        make()(*network_inputs(x.values()))
