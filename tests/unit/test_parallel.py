import pytest
import torch

from dancediff.diffusion.schedule import gaussian
from dancediff.motion.representation import LODGE
from dancediff.papers.lodge.choreography import make_cues
from dancediff.papers.lodge.global_diffusion import GlobalConfig, GlobalDenoiser
from dancediff.papers.lodge.local_diffusion import LocalConfig, LocalDenoiser
from dancediff.papers.lodge.parallel import (
    LOCALS,
    Sampling,
    dance,
    layout_of,
    sample_locals,
    sample_primitives,
    sample_rows,
    style_tokens,
)
from dancediff.papers.lodge.primitives import DISCRETE, thinned_primitives
from dancediff.papers.lodge.stitch import plan

N, n = 256, 64
TINY = {"d_model": 16, "num_heads": 2, "num_layers": 1, "ff_dim": 32}


@pytest.fixture(scope="module")
def stages():
    torch.manual_seed(0)
    coarse = GlobalDenoiser(GlobalConfig(**TINY, music_frames=N, local_frames=n))
    fine = LocalDenoiser(LocalConfig(**TINY, num_frames=n))
    return coarse.eval(), fine.eval()


def music(frames, beat=15):
    M = torch.rand(frames, 35, generator=torch.Generator().manual_seed(1))
    M[:, 33:] = 0
    M[::beat, 34] = 1
    return M


def make(stages, frames, at_once=None, **options):
    how = {"steps": 3, "at_once": at_once, **options.pop("how", {})}
    return dance(*stages, music(frames), frames, genre=0, how=Sampling(**how), **options)


@pytest.mark.parametrize("at_once", [1, 2, 7, 16])
def test_chunks_give_the_same_dance(stages, at_once):
    frames = 16 * n - 5
    for feet in ("free", "planted"):
        whole = make(stages, frames, feet=feet)
        assert whole.shape == (frames, 139) and whole.isfinite().all()
        assert (make(stages, frames, at_once, feet=feet) - whole).abs().max() < 1e-4


def test_a_preconditioned_guess_is_not_cut():
    """Without preconditioning it is, as in EDGE; a dancer may always leave the floor's unit."""
    for precondition, most in ((True, 5.0), (False, 1.0)):
        model = LocalDenoiser(LocalConfig(**TINY, num_frames=n, precondition=precondition))
        far = torch.full((1, n, 139), 5.0)
        model.forward = lambda x_t, t, conditions, far=far: (far, far)
        style = style_tokens(model, 0, 1, Sampling())
        x = sample_rows(model, music(n)[None], style, Sampling(steps=2, guidance=1), LOCALS)
        floor = [LODGE.root.start, LODGE.root.start + 2]
        assert x[..., floor].min().item() == 5.0
        assert x[..., [c for c in range(139) if c not in floor]].max().item() == most


def test_other_seeds_are_other_dances(stages):
    a, b = (make(stages, n, how={"seed": seed}) for seed in (0, 1))
    assert (a - b).abs().max() > 0.1


@pytest.mark.parametrize("frames", [1, n - 1, n, N, N + 1, 2 * N + n + 3])
def test_every_length(stages, frames):
    assert make(stages, frames, at_once=2).shape == (frames, 139)


def test_progress_counts_every_step(stages):
    seen = []
    make(stages, 5 * n, at_once=2, report=lambda done, total: seen.append((done, total)))
    # 2 globals in 1 chunk, 5 locals in 3
    assert seen == [(k, 12) for k in range(1, 13)]


def test_hard_cues_are_in_the_dance_and_neighbours_share_them(stages):
    coarse, fine = stages
    segments, how = plan(4 * n, layout_of(coarse)), Sampling(steps=3)
    M = music(4 * n)
    primitives = sample_primitives(
        coarse, segments.global_music(M), style_tokens(coarse, 1, 1, how), how
    )
    cues = make_cues(primitives, segments)
    x = sample_locals(
        fine, segments.local_music(M), cues, style_tokens(fine, 1, 4, how), how, soft=0.0
    )
    held = cues.hard[..., None] & cues.channels
    assert torch.allclose(x[held], cues.value[held], atol=1e-5)
    h1 = primitives[0, 3, :, LODGE.rot6d]
    assert torch.allclose(torch.cat([x[0, -4:], x[1, :4]])[:, LODGE.rot6d], h1, atol=1e-5)
    free = ~cues.hard[..., None] & cues.channels
    assert not torch.allclose(x[free], cues.value[free], atol=0.1)


def test_soft_cues_pull_the_more_the_longer_they_are_held(stages):
    coarse, fine = stages
    segments, how = plan(2 * n, layout_of(coarse)), Sampling(steps=8)
    M = music(2 * n)
    cues = make_cues(0.5 * torch.rand(1, 13, 8, 139), segments)
    soft = (cues.soft & ~cues.hard)[..., None] & cues.channels
    style = style_tokens(fine, 1, 2, how)

    def miss(s):
        x = sample_locals(fine, segments.local_music(M), cues, style, how, soft=s, feet="free")
        return (x - cues.value)[soft].square().mean()

    assert miss(1.0) < miss(0.0)


def test_a_long_dance_stays_where_it_is(stages):
    """Without ``home`` every segment goes on from where the last one got to."""
    fine = LocalDenoiser(LocalConfig(**TINY, num_frames=n))
    fine.precondition.spread.copy_(1 / (1 + torch.arange(n))[:, None] ** 2)  # slow parts are large
    walk = torch.linspace(0, 1, n)[None, :, None]
    fine.forward = lambda x_t, t, conditions: 2 * (walk.expand(*x_t.shape),)
    ends = {
        home: make((stages[0], fine), 9 * n, home=home)[n - 1 :: n, [4, 6]].abs()
        for home in (True, False)
    }
    assert ends[True].max() < 0.3
    assert ends[False].max() > 8


def test_one_style_for_all_segments(stages):
    how = Sampling(seed=4)
    a = style_tokens(stages[1], 2, 3, how)
    assert torch.equal(a[0], a[2])
    assert not torch.equal(a[0], style_tokens(stages[1], 3, 1, how)[0])
    assert not torch.equal(a[0], style_tokens(stages[1], 2, 1, Sampling(seed=5))[0])


def test_a_stage_without_genres_needs_no_style():
    bare = GlobalDenoiser(GlobalConfig(**TINY, music_frames=N, local_frames=n, genres=()))
    how = Sampling(steps=2)
    assert style_tokens(bare, 0, 1, how) is None
    M = music(N)[None]
    assert sample_primitives(bare.eval(), M, None, how).shape == (1, 13, 8, 139)


def test_thinned_dances_give_primitives_of_the_same_length(stages):
    discrete = GlobalConfig(**TINY, music_frames=1024, local_frames=256, variant="discrete")
    coarse = GlobalDenoiser(discrete).eval()
    assert layout_of(coarse) == DISCRETE
    how = Sampling(steps=2)
    style = style_tokens(coarse, 0, 1, how)
    assert sample_primitives(coarse, music(1024)[None], style, how).shape == (1, 13, 8, 139)
    x = torch.arange(256.0)[:, None].expand(256, 139)
    first = thinned_primitives(x)[:, 0, 0]
    assert first[[0, 3, 6, 9, 12]].tolist() == [0, 60, 124, 188, 248]


@pytest.mark.parametrize("at_once", [0, -1, 1.5, "2"])
def test_a_bad_chunk_is_refused(at_once):
    with pytest.raises(ValueError, match="at_once="):
        Sampling(at_once=at_once)


def test_rows_draw_their_own_noise():
    rows = Sampling(seed=7).generators(LOCALS, 4)
    apart = [gaussian((2,), generator=g) for g in Sampling(seed=7).generators(LOCALS, 4)]
    together = gaussian((4, 2), generator=rows)
    assert torch.equal(together, torch.stack(apart))
    assert len({row[0].item() for row in together}) == 4
    with pytest.raises(ValueError, match="3 generators for 2 rows"):
        gaussian((2, 2), generator=rows[:3])
