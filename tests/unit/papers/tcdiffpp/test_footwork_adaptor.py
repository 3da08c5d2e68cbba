import pytest
import torch

from dancediff.extensions.residuals import FootworkResidual
from dancediff.motion.representation import TCDIFFPP
from dancediff.motion.skeleton import LOWER_BODY
from dancediff.papers.tcdiffpp.footwork_adaptor import (
    FASTEST,
    ConcatSquashLinear,
    FootworkAdaptor,
    ground_velocity,
)

LEGS = TCDIFFPP.joint_channels(LOWER_BODY)
REST = sorted(set(range(151)) - set(LEGS))


def perturb(module, size=0.1):
    for parameter in module.parameters():
        parameter.data += size * torch.randn_like(parameter)
    return module


def test_concat_squash_linear_is_its_equation():
    torch.manual_seed(0)
    layer, x, c = perturb(ConcatSquashLinear(4, 6, 2)), torch.randn(3, 4), torch.randn(3, 2)
    expected = (x @ layer.linear.weight.T + layer.linear.bias) / (
        1 + torch.exp(-(c @ layer.gate.weight.T + layer.gate.bias))
    ) + c @ layer.shift.weight.T
    torch.testing.assert_close(layer(x, c), expected)
    assert layer.shift.bias is None


def test_velocity_is_of_the_ground_plane_per_second():
    x = torch.zeros(1, 1, 3, 151)
    x[0, 0, :, 4], x[0, 0, :, 5] = torch.tensor([0.0, 0.05, 0.09]), torch.tensor([0.0, 9.0, 0.0])
    x[0, 0, :, 6] = torch.tensor([1.0, 1.0, 0.5])
    expected = torch.tensor([[0, 0], [1.5, 0], [1.2, -FASTEST]])  # the last is cut off
    torch.testing.assert_close(ground_velocity(x)[0, 0], expected)


def test_only_the_legs_change():
    torch.manual_seed(0)
    adaptor, x = perturb(FootworkAdaptor()), torch.randn(2, 3, 5, 151)
    v = ground_velocity(x)
    y = adaptor(x, v)
    assert torch.equal(y[..., REST], x[..., REST])
    assert ((y - x)[..., LEGS].abs().amax(dim=(0, 1, 2)) > 0).all()
    torch.testing.assert_close(y[..., LEGS], adaptor.adapt(x, v)[..., LEGS])


def test_legs_react_to_the_path():
    """Same pose, same frame, another velocity: other legs."""
    torch.manual_seed(0)
    adaptor, x = perturb(FootworkAdaptor()), torch.randn(1, 1, 2, 151)
    slower = x.clone()
    slower[0, 0, 0, 4] = slower[0, 0, 1, 4]
    faster, slower = (adaptor(x, ground_velocity(part)) for part in (x, slower))
    change = (slower - faster)[0, 0, 1]
    assert change[LEGS].abs().max() > 1e-3


def test_first_frame_stands_still():
    assert ground_velocity(torch.randn(2, 3, 5, 151))[:, :, 0].abs().max() == 0


@pytest.mark.parametrize("hidden", [128])
def test_learns_legs_that_depend_on_the_velocity(hidden):
    """No residual path leads around it, yet it fits a velocity-dependent correction quickly."""
    torch.manual_seed(0)
    adaptor = FootworkAdaptor(hidden)
    x = torch.randn(8, 1, 20, 151) * 0.4
    x[..., 4:7] *= 0.1
    target = x.clone()
    target[..., LEGS] += 0.3 * torch.tanh(ground_velocity(x).sum(-1, keepdim=True) / 3)
    optimizer = torch.optim.Adam(adaptor.parameters(), 3e-3)

    def loss():
        return (adaptor(x, ground_velocity(x)) - target)[..., LEGS].square().mean()

    first = loss().item()
    for _ in range(150):
        optimizer.zero_grad()
        step = loss()
        step.backward()
        optimizer.step()
    assert loss().item() < first / 10


def test_stays_in_float32_under_autocast():
    adaptor, x = FootworkAdaptor(), torch.randn(1, 1, 4, 151)
    y = adaptor(x, ground_velocity(x))
    with torch.autocast("cpu", torch.bfloat16):
        assert torch.equal(adaptor(x, ground_velocity(x)), y)


def test_with_a_residual_legs_start_as_they_are():
    x = torch.randn(2, 3, 5, 151)
    y = FootworkResidual(FootworkAdaptor())(x, ground_velocity(x))
    assert torch.equal(y[..., REST], x[..., REST])
    assert 0 < (y - x).abs().max() < 0.05
