import torch

from dancediff.autoregression.draw import draw

LOGITS = torch.tensor([[2.0, 1.0, 0.0, -1.0]])


def many(count=2000, **how):
    g = torch.Generator().manual_seed(0)
    return torch.cat([draw(LOGITS, [g], **how) for _ in range(count)])


def test_shares_are_those_of_the_softmax():
    for temperature in (1.0, 0.5):
        codes = many(temperature=temperature, top_k=4)
        share = torch.bincount(codes, minlength=4) / len(codes)
        assert torch.allclose(share, (LOGITS[0] / temperature).softmax(-1), atol=0.04)


def test_only_the_most_likely_are_drawn():
    assert set(many(200, temperature=9.0, top_k=2).tolist()) == {0, 1}
    assert set(many(20, temperature=9.0, top_k=1).tolist()) == {0}
    assert set(many(400, temperature=9.0, top_k=99).tolist()) == {0, 1, 2, 3}


def test_a_row_does_not_depend_on_the_others():
    rows = LOGITS.repeat(3, 1)
    together = draw(rows, [torch.Generator().manual_seed(k) for k in range(3)],
                    temperature=1.0, top_k=4)  # fmt: skip
    for k in range(3):
        alone = draw(LOGITS, [torch.Generator().manual_seed(k)], temperature=1.0, top_k=4)
        assert alone[0] == together[k]
