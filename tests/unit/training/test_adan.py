import pytest
import torch

from dancediff.training.adan import Adan
from dancediff.training.checkpoint import Checkpointer
from dancediff.training.ema import EMA


def by_hand(gradients, lr, betas, eps, decay):
    """Algorithm 1 for one weight, in plain numbers."""
    weight, m, v, n, last = 1.0, 0.0, 0.0, 0.0, gradients[0]
    for k, g in enumerate(gradients, start=1):
        change, last = g - last, g
        m = betas[0] * m + (1 - betas[0]) * g
        v = betas[1] * v + (1 - betas[1]) * change
        n = betas[2] * n + (1 - betas[2]) * (g + betas[1] * change) ** 2
        m_, v_, n_ = (x / (1 - b**k) for x, b in zip((m, v, n), betas, strict=True))
        weight = (weight - lr * (m_ + betas[1] * v_) / (n_**0.5 + eps)) / (1 + lr * decay)
    return weight


def test_is_algorithm_1():
    gradients, weight = [0.3, -0.2, 0.5, 0.1], torch.nn.Parameter(torch.ones(1).double())
    options = {"lr": 0.01, "betas": (0.9, 0.8, 0.7), "eps": 1e-8}
    optimizer = Adan([weight], **options, weight_decay=0.1)
    for g in gradients:
        weight.grad = torch.tensor([g]).double()
        optimizer.step()
    assert weight.item() == pytest.approx(by_hand(gradients, **options, decay=0.1), rel=1e-6)


def test_finds_the_bottom_of_a_bowl():
    weight = torch.nn.Parameter(torch.tensor([3.0, -2.0]))
    optimizer = Adan([weight], lr=0.05, weight_decay=0.0)
    for _ in range(300):
        optimizer.zero_grad()
        (weight * torch.tensor([1.0, 10.0])).square().sum().backward()
        optimizer.step()
    assert weight.abs().max() < 0.2  # a few steps of 0.05 around it


def test_goes_on_from_its_state():
    def run(steps, state=None, weight=None):
        weight = torch.nn.Parameter(torch.ones(3) if weight is None else weight.clone())
        optimizer = Adan([weight], lr=0.1)
        if state is not None:
            optimizer.load_state_dict(state)
        for k in steps:
            weight.grad = torch.sin(weight.detach() * (k + 1))
            optimizer.step()
        return weight.detach(), optimizer.state_dict()

    weight, state = run(range(3))
    assert torch.equal(run(range(3, 6), state, weight)[0], run(range(6))[0])


def test_a_checkpoint_brings_all_of_it_back(tmp_path):
    def parts():
        model = torch.nn.Linear(2, 2)
        return {"model": model, "ema": EMA(model), "optimizer": Adan(model.parameters(), lr=0.1)}

    def go(parts, k):
        parts["optimizer"].zero_grad()
        parts["model"](torch.full((1, 2), float(k))).square().sum().backward()
        parts["optimizer"].step()

    old, new, path = parts(), parts(), tmp_path / "c.safetensors"
    for k in range(3):
        go(old, k)
    Checkpointer(path, **old, facts={}).save(3)
    assert Checkpointer(path, **new, facts={}).load() == 3
    for k in range(3, 5):
        go(old, k)
        go(new, k)
    assert torch.equal(old["model"].weight, new["model"].weight)


def test_a_weight_without_gradient_stays():
    weight = torch.nn.Parameter(torch.ones(2))
    Adan([weight]).step()
    assert weight.tolist() == [1.0, 1.0]
    with pytest.raises(ValueError, match="closure"):
        Adan([weight]).step(lambda: 0.0)
