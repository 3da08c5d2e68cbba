import pytest
import torch

from dancediff.training.ema import EMA


def constant(value):
    net = torch.nn.Linear(1, 1, bias=False)
    torch.nn.init.constant_(net.weight, value)
    return net


def test_young_average_hardly_remembers_the_start():
    """After k updates towards 1, what is left of the start at 0 is the product of all m_k."""
    net, ema = constant(1.0), EMA(constant(0.0), decay=0.999)
    left = 1.0
    for k in range(1, 30):
        ema.update(net)
        left *= (1 + k) / (10 + k)
        assert ema.model.weight.item() == pytest.approx(1 - left, abs=1e-6)
    assert left < 1e-4  # a plain 0.999 would still hold 97 % of the random start


def test_old_average_moves_by_one_minus_decay():
    net, ema = constant(1.0), EMA(constant(0.0), decay=0.9)
    ema.updates = 10_000
    ema.update(net)
    assert ema.model.weight.item() == pytest.approx(0.1)


def test_average_is_a_copy_that_does_not_train():
    net = torch.nn.Sequential(torch.nn.Linear(2, 2), torch.nn.Dropout())
    ema = EMA(net)
    with torch.no_grad():
        net[0].weight.fill_(7.0)
    assert not (ema.model[0].weight == 7.0).any()
    assert not ema.model.training and net.training
    assert not any(p.requires_grad for p in ema.model.parameters())


def test_update_leaves_the_model_alone():
    net, ema = constant(0.25), EMA(constant(1.0))
    ema.update(net)
    assert net.weight.item() == 0.25 and net.weight.requires_grad


def test_the_average_has_no_graph_that_grows_with_every_update():
    net = torch.nn.Linear(2, 2)
    ema = EMA(net)
    ema.update(net)
    assert not any(weights.requires_grad for weights in ema.model.parameters())
