"""What we add to Lodge's sampling, step by step: `dancediff.generation.lodge_dance`."""

import pytest
import torch

from dancediff.data.choreographer.structure import Section
from dancediff.extensions.smooth_primitives import smooth_primitives
from dancediff.generation import lodge_dance
from dancediff.generation.lodge_dance import LodgeSampler
from dancediff.generation.request import LodgeRequest
from dancediff.hub import packaged_song
from dancediff.motion.representation import LODGE
from dancediff.papers.lodge.parallel import LOCALS, ParallelSampler
from dancediff.papers.lodge.segments import segments_of
from tiny_lodge import ask, tiny_lodge

n = 64


@pytest.fixture(scope="module")
def model():
    model = tiny_lodge()
    std = model.local_stage.std
    std.copy_(0.5 / (1 + torch.arange(n))[:, None] ** 2)  # slow parts are large
    return model


def music(frames, beat=15):
    M = torch.rand(frames, 35, generator=torch.Generator().manual_seed(1))
    M[:, 33:] = 0
    M[::beat, 34] = 1
    return M


def sampler(model, kind=LodgeSampler, **options):
    return kind(model.global_stage, model.local_stage, ask(**options))


def dance(model, frames, kind=LodgeSampler, **options):
    return sampler(model, kind, **options).dance(music(frames), frames)


def test_with_everything_off_it_is_the_papers_sampler():
    plain = tiny_lodge(())
    assert torch.equal(dance(plain, 4 * n), dance(plain, 4 * n, ParallelSampler))


@pytest.mark.parametrize(
    "name",
    ["border_smoothing", "stage_spots", "foot_contact", "root_stitching"],
)
def test_each_addition_changes_the_dance(model, name):
    assert not torch.allclose(dance(model, 3 * n), dance(model, 3 * n, **{name: True}), atol=1e-4)


def test_autoguidance_changes_the_dance_and_so_does_its_end(model):
    usual, pushed = (dance(model, n, autoguidance=w) for w in (1.0, 1.3))
    ended = dance(model, n, autoguidance=1.3, autoguidance_end=1.0)
    for one, other in ((usual, pushed), (usual, ended), (pushed, ended)):
        assert not torch.allclose(one, other, atol=1e-4)


def test_the_packaged_preset_pushes_guesses_away_from_the_linear_one(model):
    """The paper's takes them as they are."""
    song, stage = packaged_song(), model.local_stage
    x_t, M = torch.randn(2, n, 139), music(n).expand(2, -1, -1)
    away = {}
    for preset in ("paper", "packaged"):
        asked = LodgeRequest(preset=preset, genre="hiphop", guidance=1.0).resolve(model, song)
        steps = LodgeSampler(model.global_stage, stage, asked)
        conditions = steps.conditions(stage, M, 0)
        linear = stage.linear_guess(x_t, torch.full((2,), 500), conditions)
        with torch.no_grad():
            away[preset] = steps.guess(stage, conditions)(x_t, 500) - linear
    rest = slice(LODGE.root.stop, None)
    assert away["packaged"][..., rest].norm() > 1.05 * away["paper"][..., rest].norm()


def test_a_mix_of_genres_is_that_of_their_styles(model):
    style, z = model.local_stage.style, torch.randn(1, 64)
    hiphop, salsa, mixed = (
        sampler(model, genre=genre).token(style, z)
        for genre in ("hiphop", "salsa", {"hiphop": 0.25, "salsa": 0.75})
    )
    torch.testing.assert_close(mixed, 0.25 * hiphop + 0.75 * salsa)


def test_each_segment_gets_its_own_energy():
    listens = tiny_lodge(("preconditioning", "energy_condition"))
    made = sampler(listens)
    made.energy, made.segments = torch.rand(8 * n), segments_of(8 * n, layout(listens))
    for stage, length in ((listens.local_stage, n), (listens.global_stage, 4 * n)):
        given = made.conditions(stage, torch.zeros(1, length, 35), first=1).energy
        assert torch.equal(given[0], made.energy[length : 2 * length])


def layout(model):
    return model.config.global_stage.layout


def test_primitives_are_smooth_if_asked_for(model):
    segments = segments_of(4 * n, model.config.global_stage.layout)
    raw, smooth = (
        sampler(model, smooth_primitives=on).primitives(music(4 * n), segments)
        for on in (False, True)
    )
    assert torch.equal(smooth, smooth_primitives(raw)) and not torch.allclose(raw, smooth)


def test_sections_are_repeated_if_asked_for(model, monkeypatch):
    verse = [Section(0, 2 * n, "verse", 0), Section(2 * n, 4 * n, "verse", 2)]
    monkeypatch.setattr(lodge_dance, "find_sections", lambda M: verse)
    M, segments = music(4 * n, beat=32), segments_of(4 * n, model.config.global_stage.layout)
    primitives = torch.randn(1, 13, 8, 139)
    for on in (False, True):
        made = sampler(model, repeat_sections=on).arrange(primitives, M, segments)
        assert torch.equal(made.soft[:2], made.soft[2:]) == on


def test_a_preconditioned_guess_is_not_cut(model):
    stage, far = tiny_lodge().local_stage, torch.full((1, n, 139), 5.0)
    stage.denoise = lambda x_t, t, conditions: far
    made = LodgeSampler(model.global_stage, stage, ask(guidance=1.0))
    assert made.sample(stage, LOCALS, music(n)[None], 0).min() == 5.0


def test_a_long_dance_stays_on_the_stage(model):
    """Otherwise every segment goes on from where the last one got to."""
    fine = tiny_lodge().local_stage
    std = fine.std
    std.copy_(1 / (1 + torch.arange(n))[:, None] ** 2)  # slow parts are large
    walk = torch.linspace(0, 1, n)[None, :, None]
    fine.denoise = lambda x_t, t, conditions: walk.expand(*x_t.shape)
    ends = {}
    for on in (True, False):
        asked = ask(root_stitching=True, stage_spots=on)
        x = LodgeSampler(model.global_stage, fine, asked).dance(music(9 * n), 9 * n)
        ends[on] = x[n - 1 :: n, LODGE.floor].abs()
    assert 0.3 < ends[True].max() < 1.6, "spots near the middle, not all the same"
    assert ends[False].max() > 8


def test_chunks_give_the_same_dance(model):
    on = dict.fromkeys(("root_stitching", "stage_spots"), True)
    on |= {"foot_contact": True, "smooth_primitives": True, "autoguidance": 1.3}
    whole, parts = (dance(model, 9 * n - 5, at_once=k, **on) for k in (None, 2))
    assert (whole - parts).abs().max() < 1e-4
