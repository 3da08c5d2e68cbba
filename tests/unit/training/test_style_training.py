"""Genre and energy in training: what is dropped, where names come from, and that they are learned.

Everything is random from the seed and the number of the batch.
"""

import pytest
import torch

from dancediff import hub
from dancediff.data.choreographed import choreographed_takes
from dancediff.data.windows import Batch
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.extensions.build import build
from dancediff.extensions.genre_condition import genres_of
from dancediff.extensions.preconditioning import preconditioning_of
from dancediff.genre import GENRES
from dancediff.hub import packaged_song
from dancediff.motion.motion import Motion
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.lodge.losses import LodgeWeights
from dancediff.training.config import TrainConfig
from dancediff.training.lodge_losses import LodgeObjective
from dancediff.training.objective import GroupObjective
from dancediff.training.run import MODELS, check_tables, train_from_config
from tiny_lodge import tiny_lodge

TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32, "num_frames": 20}
STYLED = ("genre_condition", "energy_condition")
NAMES = ("hiphop", "house")


def edge(extensions=STYLED, **sizes) -> EDGE:
    torch.manual_seed(0)
    return build(EDGE, EDGEConfig(**TINY | sizes), extensions, NAMES)


def windows(b: int) -> Batch:
    g = torch.Generator().manual_seed(0)
    genre = torch.eye(2)[torch.arange(b) % 2]
    x, M = torch.rand(b, 1, 20, 151, generator=g), torch.zeros(b, 20, 35)
    return Batch(x, M, torch.zeros(b, 1).long(), genre, torch.rand(b, 20, generator=g))


def conditions(objective, number: int, b: int = 2000) -> Conditions:
    batch = objective.to_network(windows(b))
    return objective.conditions(batch, objective.noised(batch.x, number))


def test_genre_energy_and_music_are_dropped_each_for_itself():
    """By chance two of them go together as often as the product of their shares."""
    given = conditions(GroupObjective(edge(), TrainConfig()), 3)
    gone = {
        "music": ~given.music_mask,
        "genre": given.genre.sum(1) == 0,
        "energy": given.energy.isnan().all(1),
    }
    shares = {"music": 0.25, "genre": 0.15, "energy": 0.15}
    for one, p in shares.items():
        assert abs(gone[one].float().mean().item() - p) < 4 * (p * (1 - p) / 2000) ** 0.5
        for other, q in shares.items():
            if one < other:
                both = (gone[one] & gone[other]).float().mean().item()
                assert abs(both - p * q) < 4 * (p * q / 2000) ** 0.5


def test_the_same_number_drops_the_same_and_another_does_not():
    objective = GroupObjective(edge(), TrainConfig())
    first, again, other = (conditions(objective, number) for number in (3, 3, 4))
    assert torch.equal(first.genre, again.genre) and not torch.equal(first.genre, other.genre)
    assert torch.equal(first.energy.isnan(), again.energy.isnan())


def test_a_model_without_the_parts_trains_as_before():
    """Neither is handed on, and the noise is the same with them and without."""
    plain, styled = (GroupObjective(edge(e), TrainConfig()) for e in ((), STYLED))
    given = conditions(plain, 3)
    assert given.genre is None and given.energy is None
    a, b = (objective.noised(windows(4).x, 3) for objective in (plain, styled))
    assert torch.equal(a.x_t, b.x_t) and torch.equal(a.mask, b.mask) and torch.equal(a.t, b.t)


@pytest.mark.parametrize("stage", ["global_stage", "local_stage"])
def test_lodge_learns_from_energy(stage):
    network = getattr(tiny_lodge(["preconditioning", "energy_condition"]), stage).train()
    c = network.config
    frames = getattr(c, "music_frames", c.num_frames)
    x, M = torch.rand(3, c.num_frames, 139), torch.rand(3, frames, 35)
    batch = Batch(x, M, torch.tensor([0, 1, 2]), None, torch.rand(3, frames))
    objective = LodgeObjective(network, TrainConfig(weights=LodgeWeights.local()))
    objective.losses(network, batch, 0)["total"].backward()
    part = network.parts["energy_condition"]
    assert part.out.weight.grad.abs().max() > 0


def test_a_config_names_the_genres():
    tables = check_tables({"model": {"extensions": ["genre_condition"]}}, "a.toml")
    assert tables["model"]["genres"] == list(GENRES)
    tables = check_tables({"model": {"extensions": ["genre_condition"], "genres": ["a"]}}, "a.toml")
    assert tables["model"]["genres"] == ["a"]
    assert "genres" not in check_tables({}, "a.toml")["model"]
    with pytest.raises(ValueError, match="'model': genres need the extension 'genre_condition'"):
        check_tables({"model": {"genres": ["a"]}}, "a.toml")
    for genres, message in (("a", "genres='a' should be a list"), (["a", "a"], "each once")):
        config = {"model": {"extensions": ["genre_condition"], "genres": genres}}
        with pytest.raises(ValueError, match=message):
            check_tables(config, "a.toml")
    assert genres_of(edge()) == NAMES


CONFIG = """
[data]
dancers_per_batch = 4
[model]
class = "KIND"
num_frames = 60
d_model = 16
num_heads = 2
num_layers = 1
ff_dim = 32
extensions = ["preconditioning", "genre_condition", "energy_condition"]
genres = ["jazz", "hiphop"]
[train]
steps = 2
"""


@pytest.mark.parametrize("kind", ["TCDiffPP", "EDGE"])
def test_from_a_config_to_a_dance(kind, tmp_path):
    (tmp_path / "c.toml").write_text(CONFIG.replace("KIND", kind))
    takes = choreographed_takes(0, seconds=6.0, sizes=(1, 2))  # in hip-hop
    trained = train_from_config(tmp_path / "c.toml", tmp_path / "run", takes=takes)
    table = trained.parts["genre_condition"].table
    torch.manual_seed(0)  # as the training
    start = build(MODELS[kind][0], trained.config, trained.extensions, ("jazz", "hiphop"))
    jazz, hiphop = (table - start.parts["genre_condition"].table).norm(dim=1)
    assert hiphop > 50 * jazz, "nobody danced jazz: only weight decay moves it"
    into = trained.parts["energy_condition"].into.weight
    assert not torch.equal(into, start.parts["energy_condition"].into.weight)
    pipeline = hub.load(hub.save_model(trained, tmp_path / "model"))
    ask = {
        "seconds": 3,
        "overlap": 30,
        "steps": 2,
        "genre": "jazz=0.5,hiphop=0.5",
        "energy": "0:0.2,3:0.9",
    }
    dance = pipeline.generate(packaged_song(), **ask)
    assert dance.meta["genre"] == {"jazz": 0.5, "hiphop": 0.5}
    dance.save(tmp_path / "dance.npz")
    again = Motion.load(tmp_path / "dance.npz")
    assert again.meta["genre"] == dance.meta["genre"]
    assert [tuple(point) for point in again.meta["energy"]] == [(0.0, 0.2), (3.0, 0.9)]


class Swings:
    """A dancer who goes to and fro, as far as the energy says; the genre says along which axis."""

    @staticmethod
    def batch(number: int) -> Batch:
        g = torch.Generator().manual_seed(number)
        energy, genre = torch.rand(32, 1, generator=g), torch.randint(2, (32,), generator=g)
        swing = energy * (0.63 * torch.arange(20)).sin()
        x = torch.zeros(32, 1, 20, 151)
        x[torch.arange(32), 0, :, 4 + 2 * genre] = swing  # root x or root z
        x[..., 7::6] = x[..., 11::6] = 1.0  # nobody turns a joint
        labels = torch.zeros(32, 1).long()
        energies = energy.expand(-1, 20).contiguous()
        return Batch(x, torch.zeros(32, 20, 35), labels, torch.eye(2)[genre], energies)


def test_a_small_network_learns_to_do_what_is_asked():
    model = edge(["preconditioning", *STYLED], d_model=32, ff_dim=64)
    preconditioning_of(model).fit([torch.cat([Swings.batch(k).x[:, 0] for k in range(900, 910)])])
    objective = GroupObjective(model, TrainConfig())
    optimizer = torch.optim.Adam(model.parameters(), lr=3e-3)
    for number in range(200):
        batch = objective.to_network(Swings.batch(number))
        noised = objective.noised(batch.x, number)
        guess = model(noised.x_t, noised.t, objective.conditions(batch, noised))
        optimizer.zero_grad()
        (guess - batch.x).square().mean().backward()
        optimizer.step()
    options = SamplerOptions(model.abar, "dpm", 8, eta=0.0)

    def danced(energy, genre=(1.0, 0.0)):
        given = Conditions(
            torch.zeros(16, 20, 35),
            genre=torch.tensor([genre]).expand(16, -1),
            energy=torch.full((16, 20), energy),
        )
        g = torch.Generator().manual_seed(1)
        steps = lambda x_t, t: model.denoise(x_t, torch.full((16,), t), given)  # noqa: E731
        with torch.no_grad():
            x = sample(steps, (16, 1, 20, 151), options, generator=g)
        return x[:, 0, :, [4, 6]].diff(dim=1).abs().mean((0, 1)).tolist()

    quiet, middle, loud = (danced(e)[0] for e in (0.1, 0.5, 0.9))
    assert quiet < 0.6 * middle < middle < 0.85 * loud
    along, across = danced(0.9, (0.0, 1.0))
    assert across > 2 * along
