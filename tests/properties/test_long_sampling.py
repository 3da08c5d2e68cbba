"""Long dances of any length and overlap: every frame is there, once, and is the right one."""

from functools import lru_cache

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dancediff.diffusion.long_sampling import SEAMS
from dancediff.diffusion.pinning import MODES
from dancediff.diffusion.samplers import SAMPLERS, SamplerOptions
from dancediff.diffusion.schedule import cosine_abar
from dancediff.extensions.root_stitching import root_stitching
from dancediff.generation.pipeline import pipeline_of
from dancediff.motion.representation import LODGE
from dancediff.papers.lodge.choreography import arrange
from dancediff.papers.lodge.primitives import Layout
from dancediff.papers.lodge.segments import segments_of
from dancediff.papers.tcdiffpp.long_group_sampling import LongGroupSampler
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig

often = settings(deadline=None, derandomize=True, max_examples=60)
seeds = st.integers(0, 2**32 - 1)
floats = {"allow_nan": False, "allow_infinity": False}


def generator(seed):
    return torch.Generator().manual_seed(seed)


@st.composite
def long_dances(draw):
    """How a long dance is cut, and how it is sampled."""
    f = draw(st.integers(2, 20))
    overlap = draw(st.integers(1, f - 1))
    how = {
        "shape": (draw(st.integers(1, 5)), f, draw(st.integers(2, 4))),
        "overlap": overlap,
        "pinning": draw(st.sampled_from(MODES)),
        "seam": draw(st.sampled_from(sorted(SEAMS))),
        "resampled": draw(st.integers(0, overlap - 1)),
        "options": SamplerOptions(
            cosine_abar(draw(st.integers(5, 12))),
            draw(st.sampled_from(SAMPLERS)),
            draw(st.integers(1, 5)),
            eta=draw(st.floats(0, 1)),
        ),
    }
    return f, draw(st.integers(1, 6)), how


def music(segments, f):
    """Segment i carries its number."""
    return torch.arange(segments).float()[:, None, None].expand(segments, f, 35)


def sampler(denoise, f, segments, how, seed=0):
    return LongGroupSampler(
        bind=lambda c: lambda x_t, t: denoise(x_t, t, c.music, c.swap),
        music=music(segments, f),
        root_x=lambda frame: frame[:, 0],
        generator=generator(seed),
        **how,
    )


def crossing(seed, n, frames, d):
    """Dancers on paths that cross, known by what never changes, numbered from the left."""
    x = torch.rand(n, frames, d, generator=generator(seed)) * 1.6 - 0.8
    x[..., -1] = torch.linspace(-0.9, 0.9, n)[:, None]
    return x[x[:, 0, 0].argsort()]


@often
@given(long_dances(), seeds)
def test_who_knows_the_dance_gets_all_of_it(cut, seed):
    f, segments, how = cut
    stride = f - how["overlap"]
    frames = f + (segments - 1) * stride
    dance = crossing(seed, how["shape"][0], frames, how["shape"][2])

    def perfect(x_t, t, M, S):
        window = dance[:, int(M[0, 0, 0]) * stride :][:, :f]
        return window[window[:, 0, 0].argsort()][None]  # ranked, as the network is trained

    x = sampler(perfect, f, segments, how, seed + 1).dance()
    assert x.shape == dance.shape
    # where two segments are blended, both are right
    torch.testing.assert_close(x, dance, atol=1e-6, rtol=0)


@often
@given(long_dances(), seeds)
def test_pieces_are_the_dance(cut, seed):
    f, segments, how = cut
    network = lambda x_t, t, M, S: torch.tanh(1.2 * x_t) + 0.01 * S[..., None, None]  # noqa: E731
    whole = sampler(network, f, segments, how, seed).dance()
    stride = f - how["overlap"]
    kept, pieces = [], sampler(network, f, segments, how, seed).pieces()
    for piece in pieces:
        assert piece.shape[1] == (stride if len(kept) < segments else how["overlap"])
        kept.append(piece.clone())
        piece.fill_(7.0)  # pieces that were handed out may be changed
    assert len(kept) == segments + 1
    assert torch.equal(torch.cat(kept, 1), whole)


@often
@given(long_dances(), seeds)
def test_a_dance_does_not_depend_on_what_comes_later(cut, seed):
    f, segments, how = cut
    network = lambda x_t, t, M, S: torch.tanh(1.2 * x_t) + 0.01 * M.mean()  # noqa: E731
    long = sampler(network, f, segments + 1, how, seed).dance()
    short = sampler(network, f, segments, how, seed).dance()
    final = segments * (f - how["overlap"])
    assert torch.equal(long[:, :final], short[:, :final])


@lru_cache
def tiny_model():
    torch.manual_seed(0)
    sizes = {"d_model": 8, "num_heads": 1, "num_layers": 1, "ff_dim": 8, "fusion_hidden": 8}
    sizes |= {"footwork_hidden": 8, "num_frames": 30}
    return pipeline_of(TCDiffPP(TCDiffPPConfig(**sizes)).eval())


class Noise:
    """What a model needs to know of a song, here of six seconds."""

    name, duration, is_silent = "noise", 6.0, False

    def features(self):
        return torch.randn(181, 35, generator=generator(0))


@settings(often, max_examples=12)
@given(st.floats(1 / 30, 6, **floats), st.integers(1, 29), st.integers(1, 5), seeds, st.data())
def test_a_streamed_dance_is_the_generated_one(seconds, overlap, dancers, seed, data):
    options = {
        "seconds": seconds,
        "overlap": overlap,
        "dancers": dancers,
        "seed": seed,
        "steps": 1,
        "pinning": data.draw(st.sampled_from(MODES)),
        "foot_contact": data.draw(st.booleans()),
    }
    if seconds > 2 and overlap > 20:
        options["overlap"] = 20  # or there would be a hundred segments
    whole = tiny_model().generate(Noise(), **options)
    pieces = list(tiny_model().stream(Noise(), **options))
    assert whole.num_frames == round(30 * seconds) == sum(p.num_frames for p in pieces)
    assert whole.num_dancers == dancers
    for name in ("pose", "root", "contact"):
        joined = torch.cat([getattr(piece, name) for piece in pieces], 1)
        assert torch.equal(joined, getattr(whole, name))


@st.composite
def layouts(draw):
    length = 2 * draw(st.integers(1, 4))
    stride = draw(st.integers(1, 3))
    n = 8 * length * stride + draw(st.integers(0, 20))
    return Layout(n * draw(st.integers(1, 4)), n, length, stride)


@often
@given(layouts(), st.integers(1, 3000))
def test_a_plan_has_every_frame_once(layout, frames):
    N, n = layout.global_frames, layout.local_frames
    segments = segments_of(frames, layout)
    assert [*segments.locals] == [*range(0, frames, n)]
    covered = {start + k for start in segments.globals for k in range(0, N, n)}
    assert covered >= set(segments.locals)  # every local lies in a global
    new = [N // n - shared for shared in segments.shared]
    assert all(k >= 1 for k in new)
    assert len(segments.locals) <= sum(new) <= max(N // n, len(segments.locals))
    M = torch.arange(frames).float()[:, None]
    local = segments.local_music(M)
    assert torch.equal(local.flatten()[:frames], M.flatten())
    assert torch.equal(local.flatten(), torch.arange(local.numel()) % frames + 0.0)
    for start, part in zip(segments.globals, segments.global_music(M), strict=True):
        assert torch.equal(part.flatten(), (start + torch.arange(N)) % frames + 0.0)


@often
@given(layouts(), st.integers(1, 1500), st.integers(0, 4), seeds, st.booleans(), st.booleans())
def test_neighbours_are_told_the_same_at_their_border(layout, frames, every, seed, mirror, align):
    segments = segments_of(frames, layout)
    shape = (len(segments.globals), layout.num_primitives, layout.length, LODGE.dim)
    primitives = torch.randn(shape, generator=generator(seed))
    beats = range(0, frames, 7 * every) if every else []
    made = arrange(primitives, segments, beats=beats if align else (), mirror=mirror)
    cues = made.cues()
    L, n, half = len(segments.locals), layout.local_frames, layout.length // 2
    assert cues.value.shape == (L, n, LODGE.dim)
    assert torch.equal(cues.hard.nonzero()[:, 1].reshape(L, -1), edge_frames(layout).expand(L, -1))
    assert (cues.soft.sum(1) == made.positions.shape[1] * layout.length).all()  # none overlap
    assert not (cues.hard & cues.soft).any()
    tails = cues.value[:-1][cues.hard[:-1]].reshape(L - 1, 2 * half, LODGE.dim)[:, half:]
    heads = cues.value[1:][cues.hard[1:]].reshape(L - 1, 2 * half, LODGE.dim)[:, :half]
    both = torch.cat([tails, heads], 1)  # the two halves of one hard primitive
    known = primitives.flatten(0, 1)
    assert all((known == primitive).all((1, 2)).any() for primitive in both)


def edge_frames(layout):
    """Where the two halves of hard primitives lie in a local."""
    half = torch.arange(layout.length // 2) * layout.stride
    return torch.cat([half, layout.local_frames - layout.stride - half.flip(0)])


@often
@given(seeds, st.integers(1, 6), st.integers(2, 40), st.data())
def test_locals_of_one_walk_are_stitched_to_that_walk(seed, L, n, data):
    blend = data.draw(st.integers(0, n // 2))
    x = torch.randn(L * n, LODGE.dim, generator=generator(seed))
    start, step = torch.randn(2, 3, generator=generator(seed + 1))
    x[:, LODGE.root] = start + 0.05 * step * torch.arange(L * n)[:, None]
    parts = x.view(L, n, -1).clone()
    # no local knows where the one before ended
    parts[1:, :, LODGE.root] -= parts[1:, :1, LODGE.root] * torch.tensor([1.0, 0.0, 1.0])
    y = root_stitching(parts, blend=blend)
    torch.testing.assert_close(y, x, atol=1e-4, rtol=0)


@often
@given(seeds, st.integers(2, 6), st.integers(4, 40), st.data())
def test_nobody_jumps_at_a_seam(seed, L, n, data):
    blend = data.draw(st.integers(0, n // 2))
    x = torch.randn(L, n, LODGE.dim, generator=generator(seed)).double()
    y = root_stitching(x, blend=blend)
    assert y.shape == (L * n, LODGE.dim)
    rest = [k for k in range(LODGE.dim) if not LODGE.root.start <= k < LODGE.root.stop]
    assert torch.equal(y[:, rest], x.flatten(0, 1)[:, rest])
    assert torch.equal(y[0, LODGE.root.start], x[0, 0, LODGE.root.start])
    for axis in range(LODGE.root.start, LODGE.root.stop):
        if blend == 0 and axis == LODGE.root.start + 1:
            continue  # heights are closed within the blend, here within nothing
        before, after = x[:-1, -1] - x[:-1, -2], x[1:, 1] - x[1:, 0]
        mean = (before + after)[:, axis] / 2
        step = y[n::n, axis] - y[n - 1 : -1 : n, axis]
        torch.testing.assert_close(step, mean, atol=1e-9, rtol=0)
