"""Guesses of FACT and MNET are added to the last frame: what that changes, and what stays."""

import numpy as np
import pytest
import torch

from dancediff import hub
from dancediff.data.choreographer import choreograph
from dancediff.extensions.build import build
from dancediff.extensions.last_frame_residual import valid
from dancediff.motion.representation import TCDIFFPP, Normalizer
from dancediff.papers.fact.model import FACT, FACTConfig
from dancediff.papers.mnet.model import MNET, MNETConfig
from dancediff.training.run import train_from_config

SIZES = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}
CASES = {"fact": (FACT, FACTConfig(**SIZES)), "mnet": (MNET, MNETConfig(**SIZES))}


def made(name, extensions=("last_frame_residual",)):
    torch.manual_seed(0)
    return build(*CASES[name], extensions).eval()


def shaken(model):
    """The same model with other weights, none of them zero."""
    for weight in model.parameters():
        g = torch.Generator().manual_seed(weight.numel())
        weight.data += 0.05 * torch.randn(weight.shape, generator=g)
    return model


def inputs(model):
    g, c = torch.Generator().manual_seed(1), model.config
    history = torch.randn(2, c.seed_frames, 151, generator=g)
    history = valid(history, model.normalizer)
    given = [history, torch.randn(2, c.music_frames, 35, generator=g)]
    if isinstance(model, MNET):
        given.append(model.style(torch.tensor([0, 3]), torch.randn(2, c.noise, generator=g)))
    return given


@pytest.mark.parametrize("name", CASES)
def test_untrained_it_stands_still(name):
    model = made(name)
    given = inputs(model)
    guess = model(*given)
    torch.testing.assert_close(guess, given[0][:, -1:].expand_as(guess))


@pytest.mark.parametrize("name", CASES)
def test_the_plain_network_s_guess_is_what_is_added(name):
    model, plain = made(name), made(name, extensions=())
    assert type(plain) is CASES[name][0]
    model.load_state_dict(plain.state_dict())
    given = inputs(model)
    added = model(*given) - plain(*given)
    last = given[0][:, -1:].clone()
    assert torch.equal(added[..., TCDIFFPP.floor], torch.zeros_like(added[..., TCDIFFPP.floor]))
    last[..., TCDIFFPP.floor] = 0
    torch.testing.assert_close(added, last.expand_as(added))


@pytest.mark.parametrize("name", CASES)
def test_a_dance_is_the_same_anywhere_on_the_stage(name):
    model = shaken(made(name))
    given = inputs(model)
    moved = given[0].clone()
    moved[..., TCDIFFPP.floor] += torch.tensor([3.0, -2.0])
    difference = model(moved, *given[1:]) - model(*given)
    expected = torch.zeros_like(difference)
    expected[..., TCDIFFPP.floor] = torch.tensor([3.0, -2.0])
    torch.testing.assert_close(difference, expected, atol=1e-4, rtol=0)


@pytest.mark.parametrize("name", CASES)
def test_rotations_do_not_grow_however_often_the_network_adds_to_them(name):
    model = shaken(made(name))
    history, *others = inputs(model)
    largest = []
    with torch.no_grad():
        for _ in range(60):
            guess = model(history, *others)
            largest.append(guess[:, 0, TCDIFFPP.rot6d].abs().max().item())
            history = torch.cat([history[:, 1:], guess[:, :1]], dim=1)
    # one step adds to numbers of at most 1; without valid(), sixty steps would add up
    assert max(largest) < 2 * largest[0]


def test_frames_of_a_dance_are_valid_already():
    x = choreograph(np.arange(0.2, 4, 0.5), dancers=2, seed=3, seconds=3.0)[0].features()
    normalizer = Normalizer.fit(x)
    y = normalizer.normalize(x)
    torch.testing.assert_close(valid(y, normalizer), y, atol=1e-3, rtol=0)
    sunk = y.clone()
    sunk[..., TCDIFFPP.height] -= 5  # under the floor: brought back to the lowest of the data
    assert (valid(sunk, normalizer)[..., TCDIFFPP.height] == -1).all()


def test_it_is_stored_with_the_model(tmp_path):
    model = made("fact")
    hub.save_model(model, tmp_path / "model")
    found = hub.load(tmp_path / "model").model
    assert found.extensions == ("last_frame_residual",)
    given = inputs(model)
    with torch.no_grad():
        torch.testing.assert_close(found(*given), model(*given), atol=1e-2, rtol=0)  # fp16


CONFIG = """
[data]
songs = 1
seconds = 6.0
workers = 1
dancers_per_batch = 2
[model]
class = "FACT"
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 32
extensions = {}
[train]
steps = 2
warmup = 0
"""


def test_a_config_names_it(tmp_path):
    path = tmp_path / "fact.toml"
    path.write_text(CONFIG.format('["last_frame_residual"]'), encoding="utf-8")
    model = train_from_config(path, tmp_path / "run")
    assert isinstance(model, FACT) and model.extensions == ("last_frame_residual",)


@pytest.mark.parametrize(
    ("value", "said"),
    [('["ssd"]', "'ssd' is not one of those of FACT: last_frame_residual"), ("3", "list of names")],
)
def test_a_config_with_another_is_refused(value, said, tmp_path):
    path = tmp_path / "fact.toml"
    path.write_text(CONFIG.format(value), encoding="utf-8")
    with pytest.raises(ValueError, match=said):
        train_from_config(path, tmp_path / "run")
