import json

import numpy as np
import pytest
import torch

import dancediff as dd
from dancediff import hub
from dancediff.extensions.group_relations import Group, canon_delays, late, nearest, places
from dancediff.generation.pipeline import pipeline_of
from dancediff.genre import GENRES, TEMPOS, genre_for
from dancediff.motion.mirror import mirror_features
from dancediff.motion.representation import LODGE, Normalizer
from dancediff.music.song import Music
from dancediff.papers.lodge.global_diffusion import GlobalConfig
from dancediff.papers.lodge.local_diffusion import LocalConfig
from dancediff.papers.lodge.model import Lodge, LodgeConfig
from tiny_lodge import GLOBAL, LOCAL, PACKAGED, tiny_lodge


class Song:
    """Noise with a beat every half second, without librosa."""

    name, is_silent, peak = "clicks", False, 1.0

    def __init__(self, seconds=20.0, every=15):
        self.duration = seconds
        self.M = torch.rand(round(30 * seconds) + 1, 35, generator=torch.Generator().manual_seed(2))
        self.M[:, 33:] = 0
        self.M[::every, 34] = 1
        self.tempo = 60 * 30 / every

    def features(self):
        return self.M


@pytest.fixture(scope="module")
def model():
    model = tiny_lodge(PACKAGED)
    # a range as dance has it: the untrained guess stays within arm's reach
    low, high = -0.3 * torch.ones(139), 0.3 * torch.ones(139)
    model.local_stage.normalizer = Normalizer(low, high)
    model.global_stage.normalizer = Normalizer(low, high)
    return model


def make(model, song=None, **options):
    options = {"seconds": 6.0, "steps": 2} | options
    return pipeline_of(model).generate(song or Song(), **options)


@pytest.mark.parametrize("seconds", [0.1, 2.0, 6.3, 20.0])
def test_any_length(model, seconds):
    motion = make(model, seconds=seconds)
    assert motion.num_dancers == 1 and motion.num_frames == round(30 * seconds)
    assert motion.joints().isfinite().all()


def test_same_seed_same_bits_other_seed_other_dance(model):
    a, b, c = (make(model, seed=seed) for seed in (3, 3, 4))
    assert torch.equal(a.pose, b.pose) and torch.equal(a.root, b.root)
    assert (a.pose - c.pose).abs().max() > 0.1


def test_meta_says_how_it_was_made(model):
    meta = make(model, seed=5, genre="salsa", soft=0.5, seconds=7).meta
    assert meta["genre"] == "salsa" and meta["soft"] == 0.5 and meta["seed"] == 5
    assert meta["seams"] == [64, 128, 192] and meta["model"] == "lodge"
    assert "overlap" not in meta and "pinning" not in meta
    json.dumps(meta)


def test_options_matter(model):
    usual = make(model, steps=6)
    changed = {
        **{"genre": "salsa", "soft": 0.0, "mirror": False, "beat_align": False},
        **{"guidance": 2.0, "autoguidance": 1.5, "eta": 1.0, "steps": 4},
    }
    for name, value in changed.items():
        other = make(model, **{"steps": 6, name: value})
        assert not torch.allclose(usual.pose, other.pose, atol=1e-4), name


def test_chunks_are_the_same_dance(model):
    whole, parts = (make(model, at_once=k) for k in (None, 1))
    assert (whole.pose - parts.pose).abs().max() < 1e-4


def test_the_genre_of_the_tempo_is_danced(model):
    song = Song(every=14)  # 129 beats a minute
    chosen = make(model, song)
    assert chosen.meta["genre"] == genre_for(song.tempo, GENRES) == "house"
    assert torch.equal(chosen.pose, make(model, song, genre="house").pose)


def test_genres_without_a_known_tempo():
    assert genre_for(100.0, ("Kun", "salsa")) == "salsa"
    assert genre_for(100.0, ("Kun", "Dai")) == "Kun"
    for tempo in (100.0, float("nan")):  # nobody falls into what was captured
        assert genre_for(tempo, ("captured_salsa", "indian", "house")) == "house"
    assert dd.genres()[:11] == [*TEMPOS, "indian"] and set(dd.genres()) <= set(GENRES)


@pytest.mark.parametrize(
    ("argument", "value", "message"),
    [
        ("dancers", 6, r"dancers=6 must lie in 1 \.\.\. 5"),
        ("dancers", 0, "dancers=0"),
        ("seconds", 99, "more than the song's"),
        ("seed", -1, "seed=-1"),
        ("steps", 0, "steps=0"),
        ("sampler", "euler", "sampler='euler'"),
        ("guidance", -1, "guidance=-1"),
        ("eta", 2, "eta=2"),
        ("autoguidance", 0.5, "autoguidance=0.5"),
        ("genre", "polka", "genre='polka' is unknown; choose one of hiphop"),
        ("soft", 1.5, "soft=1.5"),
        ("soft", "much", "soft='much'"),
        ("soft", float("nan"), "soft=nan"),
        ("at_once", 0, "at_once=0"),
        ("relation", "chaos", "relation='chaos'"),
        ("formation", "heap", "formation='heap'.*'centre'"),
        ("dtype", torch.float16, "dtype="),
        ("device", "nowhere", "device='nowhere'"),
    ],
)
def test_bad_arguments_are_named(model, argument, value, message):
    with pytest.raises(ValueError, match=message):
        make(model, **{argument: value})


def test_song_without_sound_or_length(model):
    silent, short = (Music(np.zeros(n, np.float32), 8000) for n in (16000, 4000))
    with pytest.raises(ValueError, match="silent"):
        pipeline_of(model).generate(silent)
    with pytest.raises(ValueError, match=r"0\.50 s"):
        pipeline_of(model).generate(short)


@pytest.mark.parametrize(
    ("change", "message"),
    [({"num_frames": 32}, "local_frames=64"), ({"num_steps": 9}, "num_steps")],
)
def test_stages_must_go_together(change, message):
    with pytest.raises(ValueError, match=message):
        LodgeConfig(GlobalConfig(**GLOBAL), LocalConfig(**LOCAL | change))


def test_unison_is_the_solo_on_each_place(model):
    solo, group = make(model), make(model, dancers=3, formation="V")
    assert group.meta["relation"] == "unison" and group.meta["formation"] == "V"
    for k, (x, z) in enumerate(places(3, "V")):
        assert torch.allclose(group.pose[k], solo.pose[0], atol=1e-6)
        way = group.root[k] - solo.root[0]
        assert torch.allclose(way[:, 0], torch.full_like(way[:, 0], float(x)), atol=1e-5)
        assert torch.allclose(way[:, 2], torch.full_like(way[:, 2], float(z)), atol=1e-5)
        assert torch.allclose(way[:, 1], torch.zeros_like(way[:, 1]), atol=1e-6)


def test_canon_is_late_by_four_beats_and_has_more_seams(model):
    solo, group = make(model), make(model, dancers=2, relation="canon")
    assert torch.allclose(group.pose[1, 68:], solo.pose[0, 8:-60], atol=1e-6)
    assert torch.allclose(group.pose[1, :52], solo.pose[0, :1].expand(52, -1, -1, -1), atol=1e-6)
    assert solo.meta["seams"] == [64, 128]
    assert group.meta["seams"] == [64, 124, 128]  # 64 + 60; 128 + 60 is past the end


def test_mirror_is_a_mirror_image(model):
    group = make(model, dancers=2, relation="mirror").features("lodge")
    left, right = group
    solo = make(model).features("lodge")[0]
    assert torch.allclose(left[:, LODGE.rot6d], solo[:, LODGE.rot6d], atol=1e-6)
    image = mirror_features(left, LODGE)
    image[:, LODGE.root] = right[:, LODGE.root]
    assert torch.allclose(right, image, atol=1e-5)
    assert torch.allclose(left[:, 4], -right[:, 4], atol=1e-5)


def test_formations_grow_until_nobody_collides():
    x = torch.zeros(60, 139)
    x[:, 4] = torch.linspace(0, 1.0, 60)  # both walk towards the middle: 0.7 m is not enough
    group = Group(x, places(2, "line"), relation="mirror").frames(0, 60)
    assert nearest(group[..., LODGE.root]) >= 0.75
    alike = Group(x, places(2, "line"), relation="unison").frames(0, 60)
    assert alike[0, 0, 4].item() == pytest.approx(-0.7)  # in unison nothing has to grow


@pytest.mark.parametrize("relation", ["unison", "canon", "mirror"])
def test_a_group_is_the_same_made_piece_by_piece(relation, monkeypatch):
    x = torch.zeros(4000, 139)
    x[:, 7:] = torch.rand(4000, 132, generator=torch.Generator().manual_seed(3))
    x[3700:, 4] = torch.linspace(0, 6, 300)  # in the last minute somebody comes too close
    options = {"relation": relation, "delay": [0, 50, 100]}
    group = Group(x, places(3, "V"), **options)
    usual = Group(torch.zeros_like(x), places(3, "V"), relation="unison").home
    assert torch.equal(group.home, usual) == (relation == "unison")  # the others had to grow
    monkeypatch.setattr("dancediff.extensions.group_relations.PIECE", 10**6)
    assert torch.equal(Group(x, places(3, "V"), **options).home, group.home)
    whole = group.frames(0, 4000)
    pieces = [group.frames(start, start + 77) for start in range(0, 4000, 77)]
    assert whole.shape == (3, 4000, 139) and torch.equal(torch.cat(pieces, dim=1), whole)


@pytest.mark.parametrize(
    "options",
    [{"dancers": 1}, {"dancers": 3, "relation": "canon"}, {"dancers": 2, "relation": "mirror"}],
)
def test_stream_hands_out_the_same_dance_in_pieces(model, options):
    song, request = Song(150.0), {"seconds": 130.0, "steps": 1, "seed": 3, "soft": 0.5} | options
    model = pipeline_of(model)
    whole, pieces = model.generate(song, **request), list(model.stream(song, **request))
    assert [piece.num_frames for piece in pieces] == [1800, 1800, 300]
    for name, dim in {"root": 1, "pose": 1, "contact": 1}.items():
        streamed = torch.cat([getattr(piece, name) for piece in pieces], dim)
        assert torch.equal(streamed, getattr(whole, name)), name
    assert all(piece.meta["whole"] == whole.meta for piece in pieces)
    assert model.generate(song, seconds=2.0).meta == next(model.stream(song, seconds=2.0)).meta


@pytest.mark.parametrize(
    ("argument", "value"),
    [("dancers", 9), ("soft", 2), ("genre", "polka"), ("formation", "heap"), ("at_once", 0)],
)
def test_stream_checks_at_once(model, argument, value):
    with pytest.raises(ValueError, match=f"{argument}="):
        pipeline_of(model).stream(Song(), **{argument: value})


def test_late_never_runs_out():
    x = torch.arange(3.0)[:, None]
    assert late(x, 99, ease=0).flatten().tolist() == [0.0, 0.0, 0.0]
    assert late(x, 99).flatten().tolist() == [0.0, 0.125, 0.5]
    assert torch.equal(late(x, 0), x)


def test_late_dancers_get_going_without_a_jerk():
    """Held still and let go at once, the first step of a walk is a jump of its speed."""
    walk = torch.arange(99.0)[:, None]
    jerk = {ease: late(walk, 30, ease=ease).diff(n=2, dim=0).abs().max() for ease in (0, 8)}
    assert jerk[0] == 1 and jerk[8] < 0.1
    assert torch.equal(late(walk, 30)[38:], walk[8:-30])


def test_nobody_is_late_forever():
    assert canon_delays(2, np.array([4])) == [0, 60]


def test_round_trip(model, tmp_path):
    hub.save_model(model, tmp_path / "lodge", card="hello")
    names = sorted(p.name for p in (tmp_path / "lodge").iterdir())
    assert names == ["card.md", "config.json", "global.safetensors", "local.safetensors"]
    again = hub.load(tmp_path / "lodge").model
    assert again.config == model.config and again.config.genres == GENRES
    for name, value in model.state_dict().items():
        assert torch.allclose(again.state_dict()[name], value, rtol=1e-3, atol=1e-3), name
    assert torch.equal(again.local_stage.normalizer.low, model.local_stage.normalizer.low)
    assert make(again).meta["model"] == "lodge"


@pytest.mark.parametrize(
    ("stage", "change", "message"),
    [
        ("local_stage", {"genres": "salsa"}, "should be a list of names"),
        ("local_stage", {"genres": [1]}, "should be a list of names"),
        ("local_stage", {"d_model": 10**9}, "d_model=1000000000"),
        ("local_stage", {"num_frames": 32}, "local_frames=64"),
        ("extensions", ["wings"], "'wings' is not one of"),
        ("global_stage", {"colour": 1}, "colour"),
        ("global_stage", {"d_model": 32}, "in the weights"),
        ("wrong", {}, "unknown entry 'wrong'"),
    ],
)
def test_bad_folders_are_refused(model, tmp_path, stage, change, message):
    hub.save_model(model, tmp_path)
    path = tmp_path / "config.json"
    stored = json.loads(path.read_text())
    if stage == "extensions":
        stored[stage] = change
    else:
        stored["config"][stage] = stored["config"].get(stage, {}) | change
    path.write_text(json.dumps(stored))
    with pytest.raises(ValueError, match=message):
        hub.load(tmp_path)


def test_a_missing_stage_is_named(model, tmp_path):
    hub.save_model(model, tmp_path)
    (tmp_path / "global.safetensors").unlink()
    with pytest.raises(ValueError, match=r"cannot be read.*global\.safetensors"):
        hub.load(tmp_path)


def test_two_stages_make_one_model(model):
    whole = Lodge(model.config, model.global_stage, model.local_stage).eval()
    assert whole.config == model.config
    assert torch.equal(make(whole).pose, make(model).pose)


def test_bfloat16_dance_is_close(model):
    # no noise in between: what differs is rounding alone
    options = {"steps": 4, "eta": 0.0, "guidance": 1.0, "foot_contact": False}
    exact, short = make(model, **options), make(model, dtype=torch.bfloat16, **options)
    far = make(model, seed=9, **options)
    error = (exact.joints() - short.joints()).norm(dim=-1).mean()
    assert 0 < error < 0.2 * (exact.joints() - far.joints()).norm(dim=-1).mean()


def test_leaves_the_model_and_the_sources_of_chance_as_they_were(model):
    torch.manual_seed(7)
    expected = torch.rand(1)
    torch.manual_seed(7)
    model.train()
    make(model)
    assert torch.equal(torch.rand(1), expected)
    assert model.training and all(p.requires_grad for p in model.parameters())
    model.eval()


def test_ddpm_takes_all_steps():
    seen = []
    small = tiny_lodge(first={"num_steps": 12}, second={"num_steps": 12})
    make(small, sampler="ddpm", steps=5, progress=lambda i, n: seen.append((i, n)))
    assert seen == [(k, 24) for k in range(1, 25)]
