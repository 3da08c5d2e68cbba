"""Parallel inference as in the paper: `dancediff.papers.lodge.parallel`."""

import pytest
import torch

from dancediff.diffusion.schedule import gaussian
from dancediff.motion.representation import LODGE
from dancediff.papers.lodge.choreography import arrange
from dancediff.papers.lodge.parallel import LOCALS, ParallelSampler, row_generators
from dancediff.papers.lodge.primitives import DISCRETE, thinned_primitives
from dancediff.papers.lodge.segments import segments_of
from tiny_lodge import ask, tiny_lodge

N, n = 256, 64


@pytest.fixture(scope="module")
def model():
    return tiny_lodge(())


def music(frames, beat=15):
    M = torch.rand(frames, 35, generator=torch.Generator().manual_seed(1))
    M[:, 33:] = 0
    M[::beat, 34] = 1
    return M


def sampler(model, report=None, **options):
    return ParallelSampler(model.global_stage, model.local_stage, ask(**options), report=report)


def dance(model, frames, **options):
    return sampler(model, **options).dance(music(frames), frames)


@pytest.mark.parametrize("at_once", [1, 2, 7, 16])
def test_chunks_give_the_same_dance(model, at_once):
    frames = 16 * n - 5
    whole = dance(model, frames)
    assert whole.shape == (frames, 139) and whole.isfinite().all()
    assert (dance(model, frames, at_once=at_once) - whole).abs().max() < 1e-4


def test_other_seeds_and_genres_are_other_dances(model):
    a, b, c = (dance(model, n, **one) for one in ({}, {"seed": 1}, {"genre": "salsa"}))
    assert (a - b).abs().max() > 0.1 and (a - c).abs().max() > 1e-3


@pytest.mark.parametrize("frames", [1, n - 1, n, N, N + 1, 2 * N + n + 3])
def test_every_length(model, frames):
    assert dance(model, frames, at_once=2).shape == (frames, 139)


def test_progress_counts_every_step(model):
    seen = []
    report = lambda done, total: seen.append((done, total))  # noqa: E731
    dance(model, 5 * n, at_once=2, report=report)
    # 2 globals in 1 chunk, 5 locals in 3
    assert seen == [(k, 12) for k in range(1, 13)]


def test_guesses_are_cut_but_for_the_place_on_the_floor(model):
    far = torch.full((1, n, 139), 5.0)
    stage = tiny_lodge(()).local_stage
    stage.denoise = lambda x_t, t, conditions: far
    made = ParallelSampler(model.global_stage, stage, ask(guidance=1.0))
    x = made.sample(stage, LOCALS, music(n)[None], 0)
    assert x[..., LODGE.floor].min() == 5.0
    x[..., LODGE.floor] = 0
    assert x.max() == 1.0


def test_what_is_sampled_is_the_guess_with_refined_feet(model):
    before = dance(model, n)
    refined = tiny_lodge(())
    torch.nn.init.normal_(refined.local_stage.foot_refine.out.bias)
    assert (dance(refined, n) - before).abs().max() > 0.1


def test_hard_cues_are_in_the_dance_and_both_sides_share_them(model):
    steps, M, segments = sampler(model, soft=0.0), music(4 * n), segments_of(4 * n, layout(model))
    primitives = steps.primitives(M, segments)
    arrangement = arrange(primitives, segments, mirror=True)
    x, cues = steps.locals(M, segments, arrangement), arrangement.cues()
    channels = torch.ones(139, dtype=torch.bool)
    channels[LODGE.root] = False
    held, free = cues.hard[..., None] & channels, ~cues.hard[..., None] & channels
    assert torch.allclose(x[held], cues.value[held], atol=1e-5)
    h1 = primitives[0, 3, :, LODGE.rot6d]
    assert torch.allclose(torch.cat([x[0, -4:], x[1, :4]])[:, LODGE.rot6d], h1, atol=1e-5)
    assert not torch.allclose(x[free], cues.value[free], atol=0.1)


def layout(model):
    return model.config.global_stage.layout


def test_soft_cues_pull_the_more_the_longer_they_are_held():
    model = tiny_lodge(())
    model.local_stage.denoise = lambda x_t, t, conditions: 0.97 * x_t  # takes up what it is given
    M, segments = music(2 * n), segments_of(2 * n, layout(model))
    g = torch.Generator().manual_seed(0)
    arrangement = arrange(0.5 * torch.rand(1, 13, 8, 139, generator=g), segments, mirror=True)
    cues = arrangement.cues()
    soft = (cues.soft & ~cues.hard).nonzero(as_tuple=True)

    def miss(s):
        x = sampler(model, soft=s, steps=8).locals(M, segments, arrangement)
        return (x - cues.value)[soft][:, LODGE.rot6d].square().mean()

    assert miss(1.0) < miss(0.0)


def test_beats_and_mirror_are_asked_for(model):
    M, segments = music(4 * n), segments_of(4 * n, layout(model))
    primitives = torch.randn(1, 13, 8, 139)
    positions = sampler(model).arrange(primitives, M, segments).positions
    on = (positions + n * torch.arange(4)[:, None]) % 15
    assert (on == 14).float().mean() > 0.5  # a beat sounds 45 ms before its column has it
    plain = sampler(model, beat_align=False, mirror=False).arrange(primitives, M, segments)
    assert plain.positions.tolist() == [[8, 40]] * 4


def test_one_style_for_all_segments(model):
    stage = model.local_stage
    a = sampler(model, seed=4).style(stage, 3)
    assert torch.equal(a[0], a[2])
    assert not torch.equal(a[0], sampler(model, seed=4, genre="salsa").style(stage, 1)[0])
    assert not torch.equal(a[0], sampler(model, seed=5).style(stage, 1)[0])
    assert sampler(model).style(model.global_stage, 3) is None


def test_thinned_dances_give_primitives_of_the_same_length():
    coarse = tiny_lodge((), first={"variant": "discrete"}, frames=256)
    assert layout(coarse) == DISCRETE
    M, segments = music(1024), segments_of(1024, DISCRETE)
    assert sampler(coarse, steps=2).primitives(M, segments).shape == (1, 13, 8, 139)
    x = torch.arange(256.0)[:, None].expand(256, 139)
    first = thinned_primitives(x)[:, 0, 0]
    assert first[[0, 3, 6, 9, 12]].tolist() == [0, 60, 124, 188, 248]


def test_rows_draw_their_own_noise():
    rows = row_generators(7, LOCALS, 4)
    apart = [gaussian((2,), generator=g) for g in row_generators(7, LOCALS, 4)]
    together = gaussian((4, 2), generator=rows)
    assert torch.equal(together, torch.stack(apart))
    assert len({row[0].item() for row in together}) == 4
    with pytest.raises(ValueError, match="3 generators for 2 rows"):
        gaussian((2, 2), generator=rows[:3])


def test_an_unknown_genre_is_refused(model):
    with pytest.raises(ValueError, match="genre='polka' is unknown"):
        sampler(model, genre="polka").style(model.local_stage, 1)


def test_each_purpose_has_noise_of_its_own():
    drawn = [gaussian((1, 4), generator=row_generators(7, purpose, 1)) for purpose in range(4)]
    assert torch.cat(drawn).unique(dim=0).shape == (4, 4)
