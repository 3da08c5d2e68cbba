"""Genre and energy that are asked for: their forms, errors, and what each segment gets."""

import numpy as np
import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.axes import FPS
from dancediff.extensions.build import build
from dancediff.extensions.energy_condition import EnergyCondition
from dancediff.extensions.genre_condition import GenreCondition
from dancediff.generation.energy_option import energy_for, energy_of
from dancediff.generation.genre_mix import mix_of, mix_weights
from dancediff.generation.lodge_dance import LodgeSampler
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.tcdiffpp_dance import long_group_sampler
from dancediff.genre import genre_for
from dancediff.music.energy import energy_curve
from dancediff.music.live_song import LiveSong
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.lodge.segments import segments_of
from tiny_lodge import PACKAGED, tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp

NAMES = ("hiphop", "house", "captured_salsa")
STYLED = ("preconditioning", "genre_condition", "energy_condition")
FEW = {"steps": 2, "foot_contact": False}


def stir(network):
    """Weights of the parts as after training."""
    g = torch.Generator().manual_seed(1)
    for part in network.modules():
        if isinstance(part, GenreCondition | EnergyCondition):
            for p in part.parameters():
                p.data.copy_(torch.randn(p.shape, generator=g))
    return network


@pytest.fixture(scope="module")
def song():
    return dd.packaged_song()


@pytest.fixture(scope="module")
def group():
    pipeline = tiny_tcdiffpp(STYLED)
    stir(pipeline.model)
    return pipeline


@pytest.fixture(scope="module")
def edge():
    torch.manual_seed(0)
    config = EDGEConfig(d_model=16, num_heads=2, num_layers=1, ff_dim=32)
    return pipeline_of(stir(build(EDGE, config, STYLED, NAMES)).eval())


@pytest.fixture(scope="module")
def lodge():
    return pipeline_of(stir(tiny_lodge([*PACKAGED, "energy_condition"])))


def test_a_mix_has_one_form():
    assert mix_of({"house": 1, "hiphop": 3}) == {"house": 0.25, "hiphop": 0.75}
    assert mix_of("house=1, hiphop=3") == {"house": 0.25, "hiphop": 0.75}
    assert mix_of({"house": np.float32(2), "jazz": 0}) == mix_of("house=2") == "house"
    assert mix_weights({"house": 0.25, "hiphop": 0.75}, NAMES).tolist() == [[0.75, 0.25, 0.0]]
    assert mix_weights("any", NAMES).tolist() == [[0.0, 0.0, 0.0]]


def test_two_spellings_of_a_genre_are_one(group, song):
    asked = {"Hip-Hop": 1, "hiphop": 1, "house": 2}
    assert group.resolve(song, genre=asked).genre == {"hiphop": 0.5, "house": 0.5}
    assert group.resolve(song, genre={"Hip-Hop": 1, "hiphop": 1}).genre == "hiphop"


@pytest.mark.parametrize(
    ("genre", "message"),
    [
        ({"house": -1, "jazz": 2}, "must have shares of at least 0, one of them above"),
        ({"house": 0}, "must have shares of at least 0, one of them above"),
        ({}, "must have shares of at least 0, one of them above"),
        ("house=much", "genre='house=much' must be a name, or names with shares"),
        (3, "genre=3 must be a name, or names with shares"),
    ],
)
def test_bad_mixes_are_named(group, song, genre, message):
    with pytest.raises(ValueError, match=message):
        group.resolve(song, genre=genre)


@pytest.mark.parametrize("asked", [{}, {"genre": "by tempo"}])
def test_without_a_tempo_no_genre_is_fallen_into(group, asked):
    """Whoever danced to a microphone danced contemporary: it has no tempo before the first beat."""
    silence = [np.zeros(15360, np.float32)] * 9
    heard = LiveSong(silence, 15360, seconds=8)
    request = group.stream(heard, **asked, **FEW).request
    assert request.genre == "any" and request.genre_guidance == 1
    assert group.stream(heard, genre="jazz", **FEW).request.genre == "jazz"


def test_energy_has_one_form():
    assert energy_of(2) == energy_of("2") == energy_of(np.float32(2)) == 2.0
    assert energy_of("any") == "any"
    assert energy_of([(0, 0.5), (3, 1)]) == energy_of("0:0.5,3:1") == ((0.0, 0.5), (3.0, 1.0))
    curve = torch.linspace(0, 1, 5)
    assert energy_of(curve) == energy_of(curve.numpy()) == (0.0, 0.25, 0.5, 0.75, 1.0)


@pytest.mark.parametrize(
    ("energy", "message"),
    [
        (-1, "energy=-1 must be a number of at least 0"),
        (float("nan"), "energy=nan must be a number of at least 0"),
        ("loud", "energy='loud' must be a number that the song's own is multiplied with"),
        ([], "must be a number that the song's own"),
        ([(0, 0.5, 1)], "must be a number that the song's own"),
        ([(0, 0.5), (0, 0.7)], "must have its points in the order of their seconds"),
        ([(0, 0.5), (3, 1.5)], "energy has values of 0.5 to 1.5; they must lie in 0 ... 1"),
        ([0.5, float("nan")], "they must lie in 0 ... 1"),
        ([0.5] * 7, "energy has 7 values, the dance 240 frames; give one for each"),
    ],
)
def test_bad_energies_are_named(group, song, energy, message):
    with pytest.raises(ValueError, match=message):
        group.resolve(song, seconds=8, energy=energy)


def test_a_request_is_filled_in_once(group, edge, lodge, song):
    for pipeline in (group, edge, lodge):
        assert pipeline.resolve(song).energy == 1.0
        assert pipeline.resolve(song, preset="paper").energy == "any"
    assert group.resolve(song, preset="paper").genre == "any"
    assert edge.resolve(song).genre == genre_for(song.tempo, NAMES) in ("hiphop", "house")
    assert edge.resolve(song, genre="captured_salsa").genre == "captured_salsa"
    with pytest.raises(ValueError, match="genre='waltz' is unknown; choose one of hiphop, house"):
        edge.resolve(song, genre="waltz=1,house=1")
    assert edge.resolve(song, genre="Hip-Hop").genre == "hiphop"
    assert edge.resolve(song, genre="House, hip hop").genre == {"house": 0.5, "hiphop": 0.5}


@pytest.mark.parametrize(
    "ask", [{"genre": "house"}, {"energy": 0.5}, {"energy": [(0, 1)]}, {"genre": {"a": 1, "b": 1}}]
)
def test_a_model_without_the_part_says_what_is_missing(song, ask):
    plain, (name,) = tiny_tcdiffpp(), ask
    with pytest.raises(ValueError, match=f"{name}=.* one with the extension '{name}_condition'"):
        plain.resolve(song, **ask)
    assert plain.resolve(song, **{name: "any"}) == plain.resolve(song)
    assert not {"genre", "energy"} & plain.resolve(song).facts().keys()


def test_energy_follows_the_song_or_what_replaces_it(song):
    M = song.features()
    own = energy_curve(M)
    torch.testing.assert_close(energy_for(1.0, M), own)
    torch.testing.assert_close(energy_for(0.5, M), own / 2)
    assert energy_for(100.0, M).max() == 1
    assert energy_for("any", M).isnan().all()
    made = energy_for(((1.0, 0.2), (2.0, 0.8)), M)
    at = [round(s * FPS) for s in (0, 1, 1.5, 2, 5)]
    torch.testing.assert_close(made[at], torch.tensor([0.2, 0.2, 0.5, 0.8, 0.8]))
    curve = energy_for((0.0, 0.5, 1.0), M)
    assert curve[:5].tolist() == [0.0, 0.5, 1.0, 1.0, 1.0] and len(curve) == len(M)


def test_each_segment_of_a_group_gets_its_part(group, song):
    """Segment i of 150 frames begins at 75 i; at the song's end it begins again."""
    curve = torch.rand(400, generator=torch.Generator().manual_seed(2))
    request = group.resolve(song, seconds=400 / FPS, dancers=2, energy=curve, genre="house", **FEW)
    sampler, given = long_group_sampler(group.model, song, request), []
    for number in range(sampler.num_segments):
        segment = sampler.plan(number, None if number == 0 else torch.zeros(2, 75, 151))
        given.append(sampler.conditions(segment))
    assert len(given) == 5 and all(len(one) == 1 for one in given)
    for i, one in enumerate(given):
        expected = curve[75 * i : 75 * i + 150]
        torch.testing.assert_close(one.energy[0, : len(expected)], expected)
        assert (one.energy[0, len(expected) :] == curve[-1]).all(), "the last value goes on"
        assert one.genre.argmax().item() == 3 and one.genre.sum() == 1  # of all genres


def test_each_row_of_lodge_gets_its_part(lodge, song):
    M, frames = song.features(), 200
    request = lodge.resolve(song, seconds=frames / FPS)
    stages = (lodge.model.global_stage, lodge.model.local_stage)
    sampler, own, seen = LodgeSampler(*stages, request), energy_curve(M), []
    made = sampler.conditions

    def noted(stage, music, first):
        conditions = made(stage, music, first)
        seen.append((stage, first, conditions.energy))
        return conditions

    sampler.conditions = noted
    sampler.dance(M, frames)
    layout = lodge.config.global_stage.layout
    starts = segments_of(frames, layout).locals
    for stage, first, energy in seen:
        length = layout.global_frames if stage is stages[0] else layout.local_frames
        at = (0,) if stage is stages[0] else starts
        for row, start in zip(energy, at[first:], strict=False):
            torch.testing.assert_close(row, own[torch.arange(start, start + length) % len(M)])
    assert {id(stage) for stage, *_ in seen} == {id(stage) for stage in stages}


@pytest.mark.parametrize("kind", ["group", "edge", "lodge"])
def test_energy_and_genre_change_the_dance_and_stay_in_its_facts(kind, song, request):
    pipeline = request.getfixturevalue(kind)
    ask = {"seconds": 6, **FEW}
    own = pipeline.generate(song, **ask, genre="house")
    assert own.meta["energy"] == 1.0 and own.meta["genre"] == "house"
    for change in ({"energy": 0.1}, {"energy": [(0, 1), (6, 0)]}, {"genre": "house=1,hiphop=1"}):
        other = pipeline.generate(song, **ask | {"genre": "house"} | change)
        assert (other.root - own.root).abs().max() > 1e-5, change
    again = pipeline.generate(song, **ask, genre={"house": 5})
    assert torch.equal(again.root, own.root)
    curve = energy_curve(song.features())[: own.num_frames]
    same = pipeline.generate(song, **ask, genre="house", energy=curve)
    assert "energy" not in same.meta, "a value a frame is no fact"
    if kind == "group" or kind == "edge":  # two segments; the end of the second is cut off
        torch.testing.assert_close(same.root[:, :75], own.root[:, :75], atol=1e-4, rtol=0)


def test_all_ways_of_sampling_take_both(group, song):
    for options in (
        {"long_sampling": "naive"},
        {"guidance": 2.0, "autoguidance": 1.5},
        {"sampler": "ddim", "preset": "paper", "energy": 0.5, "genre": "house"},
    ):
        ask = {"seconds": 6, "dancers": 2, **FEW, "genre": "house", "energy": 1.0} | options
        base = group.generate(song, **ask)
        assert base.root.isfinite().all()
        for change in ({"genre": "hiphop"}, {"energy": 0.1}):
            other = group.generate(song, **ask | change)
            assert (other.root - base.root).abs().max() > 1e-5, (options, change)


def test_lodge_mixes_its_style_tokens(lodge, song):
    stages = (lodge.model.global_stage, lodge.model.local_stage)

    def token(genre):
        sampler = LodgeSampler(*stages, lodge.resolve(song, genre=genre))
        return sampler.style(stages[1], 1)

    mix = token({"hiphop": 0.25, "salsa": 0.75})
    torch.testing.assert_close(mix, 0.25 * token("hiphop") + 0.75 * token("salsa"))


def test_names_of_genres_are_stored_with_the_weights(edge, song, tmp_path):
    """A later list of genres changes nothing about a model that was made with an earlier one."""
    hub.save_model(edge.model, tmp_path, dtype=torch.float32)
    again = hub.load(tmp_path)
    assert again.resolve(song, genre="captured_salsa") == edge.resolve(song, genre="captured_salsa")
    ask = {"seconds": 5, "genre": "house", **FEW}
    assert torch.equal(again.generate(song, **ask).root, edge.generate(song, **ask).root)
    text = (tmp_path / "config.json").read_text()
    (tmp_path / "config.json").write_text(text.replace('"genres"', '"other"'))
    with pytest.raises(ValueError, match="config genres=None should be a list of names"):
        hub.load(tmp_path)
