import pytest
import torch
from torch import nn

from dancediff.nn.decoder import FusionProjection
from dancediff.training import muon
from dancediff.training.checkpoint import Checkpointer
from dancediff.training.config import TrainConfig
from dancediff.training.ema import EMA
from dancediff.training.muon import Muon, MuonAdamW, orthogonalized
from dancediff.training.optimizer import make_optimizer


def network():
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(40, 64), nn.SiLU(), nn.Linear(64, 2))


def optimizer_of(model, lr=0.01):
    return MuonAdamW([{"params": list(model.parameters())}], lr=lr, weight_decay=0.0)


def run(model, optimizer, steps):
    for k in steps:
        g = torch.Generator().manual_seed(k)
        x = torch.randn(32, 40, generator=g)
        optimizer.zero_grad()
        (model(x) - x[:, :2] * x[:, 2:4]).square().mean().backward()
        optimizer.step()
    return torch.cat([p.detach().flatten() for p in model.parameters()])


def test_step_of_a_matrix_is_the_same_in_every_direction():
    """The update's singular values are one another's like, though the gradient's are not."""
    model = network()
    before = model[0].weight.detach().clone()
    run(model, optimizer_of(model), [0])
    moved = torch.linalg.svdvals((model[0].weight.detach() - before).double())
    gradient = torch.linalg.svdvals(model[0].weight.grad.double())
    strong = gradient > 0.01 * gradient[0]  # directions that 32 samples say anything about
    assert moved[strong].max() < 2.5 * moved[strong].min()
    assert gradient[0] > 3 * gradient[strong].min()


def test_step_is_as_large_as_adams():
    def size(optimizer_of):
        model = network()
        before = model[0].weight.detach().clone()
        run(model, optimizer_of(model), [0])
        return (model[0].weight.detach() - before).square().mean().sqrt().item()

    adam = size(lambda model: torch.optim.AdamW(model.parameters(), lr=0.01, weight_decay=0.0))
    assert size(optimizer_of) == pytest.approx(0.2 * adam, rel=0.3)  # Adam's later steps are 0.2


def test_small_matrices_and_vectors_stay_with_adam_and_groups_keep_their_share():
    model = nn.Sequential(network(), nn.LayerNorm(2), FusionProjection(3, 8, 64))
    optimizer = make_optimizer(model, TrainConfig(optimizer="muon"))
    assert isinstance(optimizer, MuonAdamW)
    adam, matrices = optimizer.parts
    shapes = {g["share"]: [tuple(p.shape) for p in g["params"]] for g in matrices.param_groups}
    assert shapes == {1.0: [(64, 40)], 0.2: [(64, 64)]}
    assert {g["share"] for g in adam.param_groups} == {1.0, 0.2}
    count = sum(len(g["params"]) for g in optimizer.param_groups)
    assert count == len(list(model.parameters()))


def test_without_matrices_or_without_anything_else():
    for weight in (nn.Parameter(torch.ones(3)), nn.Parameter(torch.eye(40))):
        optimizer = MuonAdamW([{"params": [weight]}], lr=0.1, weight_decay=0.0)
        assert len(optimizer.parts) == 1
        weight.sum().backward()
        optimizer.step()
        assert weight.ravel()[0] < 1


def test_a_checkpoint_brings_both_states_back(tmp_path):
    straight = network()
    whole = run(straight, optimizer_of(straight), range(6))
    first = network()
    optimizer, ema = optimizer_of(first), EMA(first)
    run(first, optimizer, range(3))
    path = tmp_path / "checkpoint.safetensors"
    Checkpointer(path, first, ema, optimizer, {}).save(3)
    second = nn.Sequential(nn.Linear(40, 64), nn.SiLU(), nn.Linear(64, 2))
    again = optimizer_of(second)
    assert Checkpointer(path, second, EMA(second), again, {}).load() == 3
    assert torch.equal(run(second, again, range(3, 6)), whole)


def test_state_of_other_weights_is_refused():
    model = network()
    optimizer = optimizer_of(model)
    run(model, optimizer, [0])
    with pytest.raises(KeyError, match="no weight has the numbers"):
        optimizer_of(nn.Linear(3, 2)).load_state_dict(optimizer.state_dict())


NEWTON_SCHULZ = {"ns_coefficients": (3.4445, -4.7750, 2.0315), "ns_steps": 5, "eps": 1e-7}


def weights_after(optimizer_of, shape, steps=3):
    draw = torch.Generator().manual_seed(1)
    W = nn.Parameter(torch.randn(shape, generator=draw))
    optimizer = optimizer_of([{"params": [W]}], lr=0.02, weight_decay=0.1, momentum=0.95)
    for _ in range(steps):
        W.grad = torch.randn(shape, generator=draw)
        optimizer.step()
    return W.detach()


def torchs(groups, **options):
    return torch.optim.Muon(groups, adjust_lr_fn="match_rms_adamw", **options)


@pytest.mark.parametrize("shape", [(40, 64), (64, 40), (48, 48)])
def test_with_bfloat16_it_is_torchs_own_to_the_last_bit(shape, monkeypatch):
    monkeypatch.setattr(muon, "fastest_dtype", lambda kind: torch.bfloat16)
    assert torch.equal(weights_after(Muon, shape), weights_after(torchs, shape))


@pytest.mark.parametrize("shape", [(40, 64), (64, 40)])
def test_with_all_digits_it_is_torchs_but_for_the_last_ones(shape, monkeypatch):
    monkeypatch.setattr(muon, "fastest_dtype", lambda kind: torch.float32)
    ours, theirs = weights_after(Muon, shape), weights_after(torchs, shape)
    begun = weights_after(Muon, shape, steps=0)
    assert (ours - theirs).norm() < 0.02 * (theirs - begun).norm()
    assert not torch.equal(ours, theirs)


@pytest.mark.parametrize("shape", [(40, 64), (64, 40)])
def test_orthogonalized_keeps_the_singular_vectors(shape):
    G = torch.randn(shape, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    X = orthogonalized(G, **NEWTON_SCHULZ, dtype=torch.float64)
    U, _, Vt = torch.linalg.svd(G, full_matrices=False)
    values = U.T @ X @ Vt.T
    assert (values - torch.diag(values.diag())).abs().max() < 1e-6
    assert 0.6 < values.diag().min() and values.diag().max() < 1.25
