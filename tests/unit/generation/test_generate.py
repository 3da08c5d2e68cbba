import math
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.autoguidance import LASTING_SHARE, ROOT_SHARE
from dancediff.extensions.control import WalkAlong
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.request import TCDiffPPRequest, default_of
from dancediff.generation.segmented_dance import largest_guess
from dancediff.generation.segments import SegmentPlan
from dancediff.music.song import Music
from dancediff.nn.conditioning import MusicEncoder
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp


@dataclass
class Tune:
    """As much of a song as `generate` looks at."""

    duration: float = 12.0
    name: str = "tune"
    is_silent: bool = False
    peak: float = 0.5

    def features(self):
        return torch.randn(
            1 + int(30 * self.duration),
            35,
            generator=torch.Generator().manual_seed(int(self.duration)),
        )


@pytest.fixture(scope="module")
def model():
    return tiny_tcdiffpp()


def dance(model, song=None, **options):
    return model.generate(song or Tune(), **{"steps": 2} | options)


@pytest.mark.parametrize(
    "seconds, frames", [(0.5, 15), (2, 60), (5, 150), (5.1, 153), (7.5, 225), (None, 360)]
)
def test_any_length(model, seconds, frames):
    motion = dance(model, seconds=seconds)
    assert motion.num_frames == frames
    assert motion.joints().isfinite().all()


@pytest.mark.parametrize("dancers", [1, 2, 5, np.int64(3)])
def test_any_group(model, dancers):
    assert dance(model, seconds=6, dancers=dancers).num_dancers == dancers


def test_short_song(model):
    assert dance(model, Tune(1.3)).num_frames == 39


def test_same_seed_same_bits_whatever_ran_before(model):
    first = dance(model, seconds=8, seed=5)
    dance(model, seconds=3, seed=6)
    torch.randn(7)
    np.random.default_rng().normal()
    again = dance(model, seconds=8, seed=5)
    assert torch.equal(first.root, again.root) and torch.equal(first.pose, again.pose)
    assert not torch.equal(first.root, dance(model, seconds=8, seed=6).root)


@pytest.mark.parametrize("guidance", [1.0, 2.0])
def test_music_is_encoded_once_a_segment_and_that_changes_nothing(model, guidance, monkeypatch):
    encode, seen = MusicEncoder._encode, []

    def counted(self, M):
        seen.append(M)
        return encode(self, M)

    monkeypatch.setattr(MusicEncoder, "_encode", counted)
    options = {"seconds": 10, "steps": 4, "guidance": guidance}
    once = dance(model, **options)
    assert len(seen) == 3  # segments
    monkeypatch.setattr("dancediff.nn.conditioning._same_place", lambda a, b: False)
    each_time = dance(model, **options)
    assert len(seen) == 3 + 3 * 4
    assert once.root.equal(each_time.root) and once.pose.equal(each_time.pose)
    encoder, M = model.model.decoder.music, torch.randn(1, 9, 35)
    assert encoder(M) is not encoder(M)  # nothing is remembered afterwards


def test_leaves_the_model_as_it_was(model):
    model.model.train()
    dance(model, seconds=1)
    assert model.model.training
    assert all(p.grad is None for p in model.model.parameters())
    model.model.eval()
    motion = dance(model, seconds=1)
    assert not model.model.training and not motion.root.is_inference()


def test_options_reach_the_sampler(model):
    base = dance(model, seconds=8)
    for changed in (
        {"guidance": 2.0},
        {"eta": 1.0},
        {"steps": 3},
        {"overlap": 60},
        {"pinning": "clean"},
        {"swap": [2, 1, 0]},
        {"sampler": "ddim"},
        {"sigma_min": 0.5},
        {"seam": "fade"},
        {"autoguidance": 2.0},
        {"foot_contact": False},
        {"song": Tune(11.0)},
    ):
        assert not torch.equal(base.root, dance(model, **{"seconds": 8} | changed).root), changed


def test_ddpm_takes_all_steps():
    torch.manual_seed(0)
    tiny = TCDiffPPConfig(
        d_model=16, num_layers=1, ff_dim=32, fusion_hidden=16, num_steps=8, without=("ssm",)
    )
    calls = []
    motion = pipeline_of(TCDiffPP(tiny)).generate(
        Tune(), seconds=2, steps=3, sampler="ddpm", progress=lambda done, total: calls.append(total)
    )
    assert motion.root.isfinite().all() and calls == [8] * 8


def test_ddpm_ends_without_guidance():
    """Its last guesses are made with the music alone."""
    tiny = TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32, fusion_hidden=16, num_steps=20)
    model, rows = TCDiffPP(tiny), []
    model.register_forward_pre_hook(lambda _, given: rows.append(len(given[0])))
    pipeline_of(model).generate(Tune(), seconds=2, sampler="ddpm", guidance=2.0)
    assert rows == [2] * 18 + [1] * 2


def test_bfloat16_dance_is_close(model):
    # rules decide yes or no, and autoguidance makes more of any difference: it shall be rounding
    options = {"seconds": 2, "foot_contact": False, "collision_avoidance": False, "autoguidance": 1}
    plain, fast = dance(model, **options), dance(model, **options, dtype=torch.bfloat16)
    assert (plain.root - fast.root).abs().max() < 0.1
    assert not torch.equal(plain.root, fast.root)


def test_a_dtype_can_be_named(model):
    given, named = (dance(model, seconds=2, dtype=one) for one in (torch.bfloat16, "bfloat16"))
    assert torch.equal(given.root, named.root)
    assert given.meta["dtype"] == named.meta["dtype"] == "bfloat16"


@pytest.mark.parametrize("faster", [torch.float32, torch.bfloat16])
def test_fastest_is_what_the_probe_finds(model, monkeypatch, faster):
    monkeypatch.setattr("dancediff.nn.precision.fastest_dtype", lambda kind: faster)
    named, probed = (dance(model, seconds=2, dtype=dtype) for dtype in (faster, "fastest"))
    assert torch.equal(named.root, probed.root)


def test_progress_counts_to_the_end(model):
    calls = []
    dance(model, seconds=8, progress=lambda done, total: calls.append((done, total)))
    assert calls == [(i, 6) for i in range(1, 7)]  # 3 segments of 2 steps


def test_guesses_can_be_watched(model):
    """One a step, of the whole segment; the last one is the dance but for who is called first."""
    seen = []
    made = dance(model, seconds=5, steps=3, watch=lambda *step: seen.append(step))
    assert [step[:2] for step in seen] == [(1, 3), (2, 3), (3, 3)]
    guesses = [guess for *_, guess in seen]
    assert all(guess.num_frames == 150 and guess.num_dancers == 3 for guess in guesses)
    last = guesses[-1].root[guesses[-1].root[:, 0, 0].argsort()]
    assert torch.allclose(last, made.root, atol=1e-4)
    assert (guesses[0].root - guesses[1].root).abs().max() > 1e-3


def test_watching_can_stop_the_dance(model):
    def stop(done, total, guess):
        raise KeyboardInterrupt

    model.model.train()
    with pytest.raises(KeyboardInterrupt):
        dance(model, seconds=2, watch=stop)
    assert model.model.training
    model.model.eval()


def test_progress_bar_closes(model, capsys):
    dance(model, seconds=2, progress=True)
    assert "dancing" in capsys.readouterr().err


def test_meta_says_how_it_was_made(model):
    meta = dance(model, seconds=2, seed=4, dancers=2, swap=[1, 0]).meta
    assert meta["seed"] == 4 and meta["song"] == "tune" and meta["model"] == "tcdiffpp"
    assert meta["steps"] == 2 and meta["guidance"] == 1 and meta["swap"] == [1, 0]


def test_one_dancer_swaps_with_nobody(model):
    solo, swapped = dance(model, seconds=1, dancers=1), dance(model, seconds=1, dancers=1, swap=[0])
    assert torch.equal(solo.root, swapped.root)


@pytest.mark.parametrize(
    "argument, value, message",
    [
        ("dancers", 0, r"dancers=0 must be a number of at least 1"),
        ("dancers", 9, r"dancers=9 must lie in 1 \.\.\. 5"),
        ("dancers", 2.0, r"dancers=2.0 must be an integer"),
        ("seed", "x", r"seed='x' must be an integer"),
        ("seed", -1, r"seed=-1 must lie in 0 \.\.\."),
        ("steps", 0, r"steps=0 must lie in 1 \.\.\. 1000"),
        ("sampler", "euler", r"sampler='euler' is not one of 'dpm', 'ddim', 'ddpm'"),
        ("guidance", -1, r"guidance=-1 must lie in 0"),
        ("guidance", math.nan, r"guidance=nan must lie in 0"),
        ("eta", 1.5, r"eta=1.5 must lie in 0 \.\.\. 1"),
        ("seconds", -3, r"seconds=-3 must be a number of at least 0"),
        ("seconds", 0, r"seconds=0 is less than a frame"),
        ("seconds", "ten", r"seconds='ten' must be a number"),
        ("seconds", 13, r"seconds=13 is more than the song's 12\.00"),
        ("swap", [0, 1], r"swap=\[0, 1\] must hold each of 0\.\.2 exactly once"),
        ("swap_at", 3, r"swap_at=3\.0 needs swap="),
        ("overlap", 150, r"overlap=150 must lie in 1 \.\.\. 149"),
        ("pinning", "glue", r"pinning='glue' is not one of"),
        ("seam", "zip", r"seam='zip' is not one of"),
        ("dtype", torch.int8, r"dtype=torch.int8 is not one of"),
        ("device", "toaster", r"device='toaster' cannot be used here"),
    ],
)
def test_bad_arguments_are_named(model, argument, value, message):
    with pytest.raises(ValueError, match=message):
        dance(model, **{argument: value})


@pytest.mark.parametrize("song", [np.zeros(44100), None])
def test_what_is_no_song_is_named(model, song):
    with pytest.raises(ValueError, match=f"song is .*{type(song).__name__[:4]}.*; give a Music"):
        model.generate(song)
    with pytest.raises(ValueError, match="give a Music or a path"):
        model.stream(song)


def test_a_network_of_no_model_has_no_pipeline():
    with pytest.raises(ValueError, match="model is a Linear; give one of TCDiffPP, EDGE"):
        pipeline_of(torch.nn.Linear(1, 1))


def test_who_cannot_be_watched_says_so(model):
    lodge = pipeline_of(tiny_lodge())
    for pipeline, more in ((model, {"long_sampling": "naive"}), (lodge, {"genre": "salsa"})):
        with pytest.raises(ValueError, match="watch= is for TCDiff"):
            pipeline.generate(Tune(), watch=print, **more)


def test_swap_at_beyond_the_dance(model):
    with pytest.raises(ValueError, match=r"swap_at=9 must lie in 0 \.\.\. 8"):
        dance(model, seconds=8, swap=[1, 0, 2], swap_at=9)


def test_song_without_sound_or_length(model):
    with pytest.raises(ValueError, match="'tune' is silent"):
        dance(model, Tune(is_silent=True, peak=0.0))
    with pytest.raises(ValueError, match=r"song is 0\.20 s long; at least 1 s"):
        dance(model, Tune(0.2))


@pytest.mark.parametrize("seconds", [1, 5, 5.04, 7.5, 20, 24, 60])
def test_segments_just_cover_the_dance(seconds):
    found = SegmentPlan.of(TCDiffPPRequest(seconds=seconds), 150)
    covered = 150 + found.stride * (found.count - 1)
    assert covered >= found.frames and (found.count == 1 or covered - found.stride < found.frames)


def test_720_frames_take_9_segments():
    assert (
        SegmentPlan.of(TCDiffPPRequest(seconds=24), 150).count == 9
    )  # the papers' evaluation length


@pytest.mark.parametrize("seconds", [6, 20, 21.3])
def test_default_swap_ends_within_the_dance(seconds):
    request = TCDiffPPRequest(seconds=seconds, dancers=2, swap=[1, 0])
    found = SegmentPlan.of(request, 150)
    orders = found.targets(request)
    chosen = next(i for i, order in enumerate(orders) if order is not None)
    ends = chosen * found.stride + 150
    assert len(orders) == found.count and ends <= found.frames < ends + found.stride
    assert sum(order is not None for order in orders) == 1


def test_music_of_segments_repeats_the_song():
    M = torch.arange(7.0)[:, None].expand(7, 2)
    cut = SegmentPlan(8, window=4, overlap=2).music(M)
    assert cut[..., 0].tolist() == [[0, 1, 2, 3], [2, 3, 4, 5], [4, 5, 6, 0]]
    long = SegmentPlan(20, window=20, overlap=2).music(M)
    assert long[0, :, 0].tolist()[:15] == [*range(7), *range(7), 0]


def test_stream_hands_out_the_same_dance_in_pieces(model):
    song = Tune()
    options = {"dancers": 2, "seconds": 8, "steps": 2, "seed": 3}
    whole, pieces = model.generate(song, **options), list(model.stream(song, **options))
    assert [piece.num_frames for piece in pieces] == [75, 75, 75, 15]
    assert torch.equal(torch.cat([piece.root for piece in pieces], 1), whole.root)
    assert torch.equal(torch.cat([piece.pose for piece in pieces], 1), whole.pose)
    assert pieces[-1].meta["whole"] == whole.meta


def test_stream_checks_at_once_and_leaves_the_model_as_it_was():
    model, song = tiny_tcdiffpp(), Tune()
    with pytest.raises(ValueError, match="dancers=9"):
        model.stream(song, dancers=9)
    model.model.train()
    pieces = model.stream(song, dancers=1, seconds=8, steps=1)
    next(pieces)
    assert torch.is_grad_enabled() and not torch.is_inference_mode_enabled()
    pieces.close()
    assert model.model.training


def test_a_long_dance_says_where_its_seams_are(model):
    song = Tune()
    options = {"dancers": 2, "steps": 1}
    assert model.generate(song, seconds=5, **options).meta["seams"] == []
    assert model.generate(song, seconds=9, **options).meta["seams"] == [150, 225]
    started = model.generate(song, seconds=9, start=[(-1, 0), (1, 0)], **options)
    assert started.meta["seams"] == [120, 195]
    started = model.generate(song, seconds=12, start=[(-1, 0), (1, 0)], **options)
    assert started.meta["seams"] == [120, 195, 270]  # no fifth segment follows at 345


def test_autoguidance_is_on_where_there_is_a_linear_guess(model):
    song = Tune()
    plain = pipeline_of(TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32)))
    ask = {"dancers": 2, "seconds": 2, "steps": 3}
    assert model.generate(song, **ask).meta["autoguidance"] == default_of(
        "tcdiffpp", "autoguidance"
    )
    assert plain.generate(song, **ask).meta["autoguidance"] == 1
    with pytest.raises(ValueError, match=r"autoguidance=1\.5 needs"):
        plain.generate(song, autoguidance=1.5, **ask)
    with pytest.raises(ValueError, match=r"autoguidance=0\.5 must lie in 1"):
        model.generate(song, autoguidance=0.5, **ask)


def test_without_preconditioning_dancers_may_stand_far_out():
    """The unit on the floor is a metre, so guesses there are not cut at 1."""
    plain = TCDiffPP(TCDiffPPConfig(d_model=16, num_layers=1, ff_dim=32))
    guess = largest_guess(plain, TCDiffPPRequest(frequency_clip=False))(
        torch.full((1, 2, 5, 151), 3.0)
    )
    assert guess[..., [4, 6]].unique().tolist() == [3.0]
    assert guess[..., [0, 5, 7]].unique().tolist() == [1.0]


def test_autoguidance_pushes_what_the_sampler_sees(model):
    model = model.model
    x_t = torch.randn(1, 2, 150, 151, generator=torch.Generator().manual_seed(0))
    M, S = torch.zeros(1, 150, 35), torch.tensor([[1, 0]])
    with torch.inference_mode():
        given = Conditions(M, swap=S)
        plain, pushed = (
            GuidedDenoiser(model, 2.0, autoguidance=w, autoguidance_end=0.0).bind(given)(x_t, 500)
            for w in (1, 1.3)
        )
        ended = GuidedDenoiser(model, 2.0, autoguidance=1.3, autoguidance_end=100.0).bind(given)
        torch.testing.assert_close(ended(x_t, 500), plain, rtol=0, atol=0)
        linear = model.linear_guess(x_t, torch.tensor([500]), given)
    w = torch.full((151,), 1.3)
    w[4:7] = 1 + 0.3 * ROOT_SHARE  # where dancers go is pushed less
    d = plain - linear
    d = d - (1 - LASTING_SHARE) * d.mean(2, keepdim=True)  # and poses that last less than movements
    torch.testing.assert_close(pushed, plain + (w - 1) * d, atol=1e-5, rtol=1e-4)
    assert (plain - linear).abs().mean() > 1e-3


def test_a_path_is_a_song_everywhere(model, tmp_path):
    samples = np.random.default_rng(0).normal(0, 0.1, 3 * 15360)
    path = Music(samples, 15360).save(tmp_path / "noise.wav")
    dance = model.generate(path, steps=2, seed=1)
    assert dance.meta["song"] == "noise" and dance.num_frames == 90
    assert model.resolve(str(path), seed=1).frames == 90
    pieces = list(model.stream(path, steps=2, seed=1))
    assert sum(piece.num_frames for piece in pieces) == 90
    assert dance.save(tmp_path / "new" / "dance.png", path).exists()


def test_who_must_stand_on_the_other_side_stays_who_it_is(model):
    """Dancers whose places are asked for are not numbered anew by where they came to stand."""
    there = WalkAlong(0, [(0, 2.0, 0.0), (10, 2.0, 0.0)])
    moved = dance(model, seconds=10, dancers=3, constraints=there)
    assert (moved.root[0, ::30, 0] - 2).abs().max() < 0.15
