"""MNET: its counts, its critic, its losses, and a dance in a genre."""

import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import Batch
from dancediff.generation.pipeline import pipeline_of
from dancediff.nn.frozen import frozen
from dancediff.papers.mnet.critic import GenreCritic, diversity, hinge, style_consistency
from dancediff.papers.mnet.model import MNET, WEIGHTS, MNETConfig
from dancediff.training.run import train_from_config
from places import CONFIGS

NAMES = ("hiphop", "house", "jazz")
TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "critic_layers": 1, "ff_dim": 32}
TINY |= {"critic_hidden": 8, "noise": 8}
SMALL = "".join(f"{name} = {value}\n" for name, value in TINY.items())
CONFIG = f'[model]\nclass = "MNET"\n{SMALL}[train]\nsteps = 3\nwarmup = 0\n'


@pytest.fixture
def model():
    torch.manual_seed(0)
    made = MNET(MNETConfig(**TINY, genres=NAMES)).eval()
    made.standing = dd.choreograph([0.5, 1.0], dancers=1, seed=0, seconds=2)[0].features()[0, 0]
    return made


@pytest.fixture(scope="module")
def takes():
    return choreographed_takes(0, seconds=6.0, sizes=(1, 2))


def batch(genres=(0, 2)):
    g, b = torch.Generator().manual_seed(1), len(genres)
    x, M = torch.randn(b, 1, 120, 151, generator=g), torch.randn(b, 120, 35, generator=g)
    known = torch.tensor([[float(k == one) for k in range(3)] for one in genres])
    return Batch(x, M, torch.zeros(b, 1), known)


def draws():
    return torch.Generator().manual_seed(0)


def count(*parts) -> int:
    return sum(p.numel() for part in parts for p in part.parameters())


def test_the_published_sizes_have_the_published_number_of_weights():
    """But for weights that nothing depends on: biases of tokens that are not there, and, in
    attention to one token, bias, queries, keys and the norm before them."""
    theirs = {"motion_dim": 147, "music_dim": 438}
    sizes = {"num_layers": 4, "num_heads": 12, "ff_dim": 2048, "hidden": 1, "genres": 10}
    with torch.device("meta"):
        model = MNET(MNETConfig.paper(**theirs))
        critic = GenreCritic(768, tokens=480, **theirs, **sizes)
    without_effect = 8 * (480**2 - 180**2) + 8 * (480**2 + 2 * 768**2 + 2 * 768)
    assert count(model.mapping) == 12_599_808
    assert count(model.generator, model.mapping) + without_effect == 79_836_307
    assert count(critic) == 23_419_947
    assert abs(count(model.critic) / 23_419_947 - 1) < 0.03


def test_losses_by_hand():
    real, fake = torch.tensor([2.0, 0.5]), torch.tensor([-3.0, 0.0])
    assert hinge(real, fake).item() == pytest.approx(0.25 + 0.5)
    assert style_consistency(torch.tensor([1.0, 3.0]), torch.tensor([0.0, 1.0])).item() == -1.5
    z, x = torch.randn(2, 8), torch.randn(2, 30, 151)
    close, far = (diversity(z, z + 1, x, x + move).item() for move in (0.1, 2.0))
    assert close == pytest.approx(1 / 0.2, rel=1e-3) and far == pytest.approx(1 / 2.1, rel=1e-3)


def test_an_exact_guess_costs_nothing(model):
    one = batch()
    perfect = model.examples(one).later
    model.forward = lambda history, M, style: perfect  # whatever the style
    terms = model.losses(one, "train", draws())
    assert terms["future"] == 0 and terms["joints"] == 0
    weights = WEIGHTS | {"diversity": model.config.diversity}
    total = sum(weight * terms[name] for name, weight in weights.items())
    assert torch.allclose(terms["total"], total)


def test_only_the_style_of_the_genre_that_is_asked_for_learns(model):
    style = model.style(torch.tensor([1, 1]), torch.randn(2, 8))
    style.sum().backward()
    for k, head in enumerate(model.mapping.heads):
        learned = [p.grad is not None and bool(p.grad.any()) for p in head.parameters()]
        assert all(learned) if k == 1 else not any(learned)


def test_generator_and_critic_learn_from_their_own_terms(model):
    terms = model.losses(batch(), "train", draws())
    generator = [*model.generator.parameters(), *model.mapping.parameters()]
    critic = list(model.critic.parameters())
    for name in ("adversarial", "consistency", "diversity", "future", "joints"):
        grads = torch.autograd.grad(terms[name], generator, retain_graph=True, allow_unused=True)
        assert any(g is not None and g.any() for g in grads), name
        assert not terms[name].requires_grad or all(
            g is None
            for g in torch.autograd.grad(terms[name], critic, retain_graph=True, allow_unused=True)
        ), name
    grads = torch.autograd.grad(terms["critic"], generator, retain_graph=True, allow_unused=True)
    assert all(g is None for g in grads)
    terms["total"].backward()
    still = [n for n, p in model.named_parameters() if not p.grad.any()]
    assert all(".heads." in n for n in still), "but those of genres that nobody asked for"


def test_a_frozen_critic_stays_as_it_was(model):
    model.critic.biases.requires_grad_(False)
    with frozen(model.critic):
        assert not any(p.requires_grad for p in model.critic.parameters())
    left = [n for n, p in model.critic.named_parameters() if not p.requires_grad]
    assert left == ["biases"]


def test_the_consistency_term_makes_a_dance_look_less_like_another_genre(model):
    """One step down the term: the score as the genre that was asked for gains on the other."""
    one = model.examples(batch())
    style = model.style(one.genre, torch.randn(2, 8)).detach()
    other = (one.genre + 1) % 3

    def gain():
        made = model(one.history, one.M, style)
        with frozen(model.critic):
            return model.score(one, made, one.genre) - model.score(one, made, other)

    before = gain()
    style_consistency(before, torch.zeros(2)).backward()
    with torch.no_grad():
        for weights in model.generator.parameters():
            if weights.grad is not None:
                weights.sub_(1e-2 * weights.grad)
    assert (gain() > before).all()


def test_the_critic_sees_the_seam(model):
    one = model.examples(batch())
    jump = one.history.clone()
    jump[:, -1, 7:60] += 1
    scores = [model.score(one._replace(history=h), one.later, one.genre)
              for h in (one.history, jump)]  # fmt: skip
    assert ((scores[0] - scores[1]).abs() > 1e-6).all()


def test_clips_of_a_batch_do_not_see_each_other(model):
    one = model.examples(batch())
    style = model.style(one.genre, torch.randn(2, 8))
    both, alone = model(one.history, one.M, style), model(one.history[:1], one.M[:1], style[:1])
    assert torch.allclose(both[:1], alone, atol=1e-5)


def test_windows_of_no_genre_are_left_out(model):
    known = batch((0, 2))
    some = known._replace(genre=known.genre * torch.tensor([[1.0], [0.0]]))
    assert len(model.examples(some).genre) == 1
    with pytest.raises(ValueError, match="no window has one of the genres"):
        model.losses(known._replace(genre=0 * known.genre), "train", draws())


def dance(model, **options):
    return pipeline_of(model).generate(dd.packaged_song(), **{"seconds": 3, "seed": 4} | options)


def test_genre_and_noise_change_a_dance(model):
    jazz = dance(model, genre="jazz", dancers=2)
    assert torch.equal(jazz.features(), dance(model, genre="jazz", dancers=2).features())
    x = jazz.features()
    assert not torch.allclose(x, dance(model, genre="house", dancers=2).features(), atol=1e-4)
    assert not torch.allclose(
        x, dance(model, genre="jazz", dancers=2, seed=5).features(), atol=1e-4
    )
    mix = dance(model, genre={"jazz": 1.0, "house": 1.0}, dancers=2)
    assert mix.meta["genre"] == {"jazz": 0.5, "house": 0.5}
    assert dance(model).meta["genre"] in NAMES
    solo = dance(model, genre="jazz", dancers=1).features()
    assert torch.allclose(solo[0, :, 7:], x[0, :, 7:], atol=1e-4)  # each dancer alone
    with pytest.raises(ValueError, match="waltz"):
        dance(model, genre="waltz")


def test_from_a_config_to_a_dance(tmp_path, takes):
    config = tmp_path / "mnet.toml"
    config.write_text(CONFIG)
    made = train_from_config(config, tmp_path / "run", takes=takes)
    hub.save_model(made, tmp_path / "model", dtype=torch.float32)
    kept = hub.load(tmp_path / "model").model
    assert kept.config == made.config
    assert torch.equal(dance(made, dancers=2).features(), dance(kept, dancers=2).features())
    config.write_text(CONFIG.replace("[train]", 'genres = ["waltz"]\n[train]'))
    with pytest.raises(ValueError, match="no take has one of the genres waltz"):
        train_from_config(config, tmp_path / "other", takes=takes)


def test_the_small_config_can_be_read():
    from dancediff.training.autoregressive import check_autoregressive_tables
    from dancediff.training.tables import read_training

    path = CONFIGS / "mnet_tiny.toml"
    tables = check_autoregressive_tables(read_training(path), str(path))
    assert len(tables["model"]["genres"]) == 10


def test_a_style_is_made_without_gradients_as_frames_are(model):
    """Else a stream differs from `generate` in the last bits."""
    seen = []
    model.mapping.register_forward_hook(lambda *_: seen.append(torch.is_grad_enabled()))
    song = dd.packaged_song()
    assert next(pipeline_of(model).stream(song, seconds=1)).num_frames == 30
    assert seen == [False]
