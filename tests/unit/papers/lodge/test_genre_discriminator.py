import pytest
import torch

from dancediff.genre import GENRES
from dancediff.papers.lodge.genre_discriminator import (
    DiscriminatorConfig,
    GenreDiscriminator,
    PlacedAttention,
)
from dancediff.training.lodge_losses import near


def make(**options):
    torch.manual_seed(0)
    sizes = {"d_model": 16, "num_heads": 2, "ff_dim": 32, "num_frames": 20, "num_layers": 2}
    sizes |= {"head_hidden": 16, "genres": GENRES}
    return GenreDiscriminator(DiscriminatorConfig(**sizes | options))


X, M = torch.randn(3, 20, 139), torch.randn(3, 20, 35)


def test_asked_genre_is_answered():
    D = make()
    logits = D.logits(X, M)
    assert logits.shape == (3, len(GENRES))
    assert torch.equal(D(X, M, torch.tensor([4, 0, 10])), logits[range(3), [4, 0, 10]])


def test_motion_and_music_are_seen():
    D, genre = make(), torch.zeros(3, dtype=torch.long)
    y = D(X, M, genre)
    assert (D(X.roll(1, 0), M, genre) - y).abs().max() > 1e-4
    assert (D(X, M.roll(1, 0), genre) - y).abs().max() > 1e-4


def test_time_is_known_through_the_places_alone():
    D, genre = make(), torch.zeros(3, dtype=torch.long)
    for attention in D.attentions:
        torch.nn.init.zeros_(attention.places)
    torch.testing.assert_close(D(X.flip(1), M.flip(1), genre), D(X, M, genre))
    for attention in D.attentions:
        torch.nn.init.normal_(attention.places)
    assert (D(X.flip(1), M.flip(1), genre) - D(X, M, genre)).abs().max() > 1e-5


def test_placed_attention_by_hand():
    torch.manual_seed(0)
    attend = PlacedAttention(4, num_heads=1, num_frames=2)
    torch.nn.init.normal_(attend.places)
    x = torch.randn(1, 4, 4)
    Q, K, V = attend.qkv(x).chunk(3, -1)
    weights = (Q @ K.mT / 4**0.5 + attend.places).softmax(-1)
    torch.testing.assert_close(attend(x), attend.out(weights @ V))


def test_every_weight_learns_but_those_of_other_genres():
    D = make()
    D(X, M, torch.tensor([0, 1, 2])).sum().backward()
    assert all(p.grad.isfinite().all() for p in D.parameters())
    still = {name for name, p in D.named_parameters() if not p.grad.any()}
    heads = {f"verdicts.heads.{k}." for k in range(3, len(GENRES))}
    assert still == {n for n, _ in D.named_parameters() if n.startswith(tuple(heads))}


@pytest.mark.parametrize("nearby", [True, False])
def test_it_can_tell_fast_from_slow_if_it_starts_nearby(nearby):
    """Every pose comes up in both genres; only how fast they follow one another differs."""
    torch.manual_seed(0)
    D = make(genres=("slow", "fast"), num_layers=1)
    if nearby:
        D.attentions[0].places.data.copy_(near(20))
    optimizer = torch.optim.AdamW(D.parameters(), lr=3e-3)
    f = torch.arange(20.0)[None, :, None]

    def batch(b=16):
        genre = torch.randint(2, (b,))
        speed = torch.where(genre == 0, 0.3, 1.5)[:, None, None]
        x = torch.sin(speed * f + 6 * torch.rand(b, 1, 139)) + 0.1 * torch.randn(b, 20, 139)
        return x, torch.zeros(b, 20, 35), genre

    for _ in range(100):
        x, music, genre = batch()
        loss = torch.nn.functional.cross_entropy(D.logits(x, music), genre)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    x, music, genre = batch(128)
    right = (D.logits(x, music).argmax(1) == genre).float().mean()
    assert right > 0.9 if nearby else right < 0.7


def test_errors():
    genre = torch.zeros(3, dtype=torch.long)
    with pytest.raises(ValueError, match="x has 19 frames; the discriminator knows 20"):
        make()(X[:, 1:], M, genre)
    with pytest.raises(ValueError, match="M has 19 frames"):
        make()(X, M[:, 1:], genre)
