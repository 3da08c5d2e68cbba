import pytest
import torch

from dancediff.nn.quantizer import VectorQuantizer, perplexity


def draws():
    return torch.Generator().manual_seed(0)


def clustered(count=256, codes=8, seed=0):
    """Vectors in as many tight clusters as there are codes."""
    g = torch.Generator().manual_seed(seed)
    centres = 5 * torch.randn(codes, 4, generator=torch.Generator().manual_seed(7))
    return centres[torch.randint(codes, (count,), generator=g)] + 0.01 * torch.randn(
        count, 4, generator=g
    )


def test_gradients_pass_as_if_there_were_no_codes():
    z = torch.randn(6, 4, requires_grad=True)
    z_q, codes, _ = VectorQuantizer(8, 4).eval()(z, draws())
    weights = torch.randn(6, 4)
    (z_q * weights).sum().backward()
    assert torch.equal(z.grad, weights)
    assert torch.allclose(z_q, torch.zeros(6, 4), atol=1e-6) and (codes == 0).all()


def test_the_nearest_code_is_taken():
    quantizer = VectorQuantizer(8, 4).train()
    quantizer(torch.randn(50, 4), draws())
    z = torch.randn(5, 3, 4)
    wanted = torch.cdist(z.flatten(0, 1), quantizer.e).argmin(-1).reshape(5, 3)
    assert torch.equal(quantizer.codes(z), wanted)


def test_averages_are_those_of_the_equation():
    quantizer = VectorQuantizer(2, 1, decay=0.9, restart=0.0).train()
    quantizer.e.copy_(torch.tensor([[0.0], [10.0]]))
    quantizer.N.copy_(torch.tensor([2.0, 4.0]))
    quantizer.S.copy_(quantizer.N[:, None] * quantizer.e)
    z = torch.tensor([[1.0], [2.0], [9.0]])
    _, codes, commitment = quantizer(z, draws())
    assert codes.tolist() == [0, 0, 1]
    assert commitment.item() == pytest.approx((1 + 4 + 1) / 3)  # from the codes before
    N = torch.tensor([0.9 * 2 + 0.1 * 2, 0.9 * 4 + 0.1 * 1])
    S = torch.tensor([0.9 * 0 + 0.1 * 3, 0.9 * 40 + 0.1 * 9])
    assert torch.allclose(quantizer.N, N) and torch.allclose(quantizer.e[:, 0], S / N)


def test_only_codes_that_are_hardly_used_begin_anew():
    quantizer = VectorQuantizer(4, 1, restart=0.05).train()
    quantizer.e.copy_(torch.tensor([[0.0], [1.0], [2.0], [99.0]]))
    quantizer.N.copy_(torch.tensor([10.0, 10.0, 10.0, 0.1]))
    quantizer.S.copy_(quantizer.N[:, None] * quantizer.e)
    z = torch.tensor([[0.0], [1.0], [2.0]] * 10)
    quantizer(z, draws())
    assert torch.allclose(quantizer.e[:3, 0], torch.tensor([0.0, 1.0, 2.0]), atol=1e-4)
    assert quantizer.e[3, 0] in (0, 1, 2) and quantizer.N[3] > 5
    still = VectorQuantizer(4, 1).eval()
    still(z, draws())
    assert not still.N.any()  # nothing is learned outside of training


def test_restarts_keep_codes_in_use():
    use = {}
    for restart in (0.0, 0.05):
        quantizer = VectorQuantizer(8, 4, restart=restart).train()
        quantizer(torch.zeros(9, 4), draws())  # a first batch in which all vectors are alike
        for step in range(300):
            quantizer(clustered(seed=step), draws().manual_seed(step))
        codes = quantizer.codes(clustered(seed=1000))
        use[restart] = len(codes.unique()), perplexity(codes, 8)
    assert use[0.0][0] < 4 and use[0.05][0] > 5 and use[0.05][1] > 4


def test_a_codebook_that_was_saved_goes_on():
    """In Bailando's code counts and sums are no buffers: the codebook is drawn anew."""
    quantizer = VectorQuantizer(8, 4).train()
    for step in range(50):
        quantizer(clustered(seed=step), draws())
    again = VectorQuantizer(8, 4).train()
    again.load_state_dict(quantizer.state_dict())
    z = clustered(seed=99)
    before = again.codes(z)
    assert torch.equal(before, quantizer.codes(z))
    again(clustered(seed=100), draws())
    assert (again.codes(z) == before).float().mean() > 0.95


def test_under_autocast_the_same_codes_are_taken_and_learned():
    one, other = VectorQuantizer(8, 4).train(), VectorQuantizer(8, 4).train()
    for step in range(3):
        z = clustered(seed=step)
        _, plain, _ = one(z, draws())
        with torch.autocast("cpu", torch.bfloat16):
            _, fast, _ = other(z, draws())
        assert torch.equal(plain, fast)
    assert torch.equal(one.e, other.e)
