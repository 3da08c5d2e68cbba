"""Both normalisers: there and back, constant channels, and finite for anything finite."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dancediff.motion.representation import Normalizer
from dancediff.music.features import BLOCKS, PEAKS, MusicNormalizer

often = settings(deadline=None, derandomize=True, max_examples=80)
seeds = st.integers(0, 2**32 - 1)
sizes = st.floats(-3, 3)  # powers of ten
rows = st.integers(1, 30)
LARGE = 1e25
BINARY = slice(PEAKS.start, None)


def data(seed, count, d, size, offset=0.0):
    x = torch.randn(count, d, generator=torch.Generator().manual_seed(seed))
    return x * 10.0**size + offset


@often
@given(seeds, rows, st.integers(1, 9), sizes, st.floats(-1e3, 1e3))
def test_there_and_back(seed, count, d, size, offset):
    x = data(seed, count, d, size, offset)
    norm = Normalizer.fit(x)
    y = norm.normalize(x)
    magnitude = x.abs().max().item()
    # float32 holds seven digits of the number, however small the range
    assert y.abs().max() <= 1 + 4e-7 * magnitude / norm.scale.min().item()
    torch.testing.assert_close(norm.unnormalize(y), x, atol=1e-6 * max(magnitude, 1), rtol=0)


@often
@given(seeds, st.integers(2, 30), sizes)
def test_the_extremes_of_the_training_set_are_the_ends_of_the_range(seed, count, size):
    x = data(seed, count, 5, size)
    y = Normalizer.fit(x).normalize(x)
    moves = x.amax(0) - x.amin(0) > 1e-6
    torch.testing.assert_close(y.amin(0)[moves], -torch.ones(5)[moves], atol=1e-5, rtol=0)
    torch.testing.assert_close(y.amax(0)[moves], torch.ones(5)[moves], atol=1e-5, rtol=0)


@often
@given(rows, st.floats(-1e3, 1e3, width=32), seeds)
def test_constant_channels_keep_their_unit(count, value, seed):
    x = data(seed, count, 3, 0.0)
    x[:, 1] = value
    norm = Normalizer.fit(x)
    assert norm.scale[1] == 1
    assert (norm.normalize(x)[:, 1] == -1).all()
    assert (norm.unnormalize(norm.normalize(x))[:, 1] == x[:, 1]).all()


@often
@given(seeds, st.integers(2, 30), st.floats(0, 3), sizes)
def test_min_span_widens_about_the_middle(seed, count, span, size):
    x = data(seed, count, 4, size)
    plain, wide = Normalizer.fit(x), Normalizer.fit(x, min_span=span)
    close = {"atol": 1e-5 * (1 + x.abs().max().item()), "rtol": 1e-5}
    torch.testing.assert_close(wide.low + wide.high, plain.low + plain.high, **close)
    torch.testing.assert_close(wide.scale, plain.scale.clamp_min(span / 2), **close)
    y = wide.normalize(x)
    assert y.abs().max() <= 1 + 1e-5


@often
@given(seeds, rows, sizes, st.sampled_from(["float32", "float16", "bfloat16"]))
def test_anything_finite_stays_finite(seed, count, size, dtype):
    norm = Normalizer.fit(data(seed, count, 6, size))
    x = data(seed + 1, 9, 6, 0.0).clamp(-1, 1)
    x = x * (6e4 if dtype == "float16" else LARGE)
    x = x.to(getattr(torch, dtype))
    assert norm.normalize(x).isfinite().all()
    assert norm.unnormalize(x).isfinite().all()


@often
@given(seeds, st.integers(2, 30), sizes, st.floats(-100, 100))
def test_music_is_standardised_and_cut(seed, count, size, offset):
    M = data(seed, count, 35, size, offset)
    M[:, BINARY] = (M[:, BINARY] > offset).float()
    norm = MusicNormalizer.fit([M])
    y = norm.normalize(M)
    assert torch.equal(y[:, BINARY], M[:, BINARY])
    assert y.isfinite().all() and y.abs().max() <= 4
    inside = y.abs() < 4
    back = y * norm.std + norm.mean
    close = 1e-5 * (1 + M.abs().max().item())
    torch.testing.assert_close(back[inside], M[inside], atol=close, rtol=0)


@often
@given(seeds, st.integers(2, 30), st.floats(-100, 100, width=32))
def test_music_that_never_changes(seed, count, value):
    norm = MusicNormalizer.fit([torch.full((count, 35), value), torch.full((1, 35), value)])
    y = norm.normalize(data(seed, 9, 35, 0.0))
    assert y.isfinite().all() and y[:, : PEAKS.start].abs().max() <= 4
    still = norm.normalize(torch.full((1, 35), value))[:, : PEAKS.start]
    assert still.abs().max() < 0.1  # the mean, but for rounding


@often
@given(seeds, st.integers(2, 9), st.sampled_from(["float32", "float16", "bfloat16"]))
def test_any_music_stays_in_range(seed, count, dtype):
    norm = MusicNormalizer.fit([data(seed, count, 35, 0.0)])
    M = data(seed + 1, 9, 35, 0.0).clamp(-1, 1) * (6e4 if dtype == "float16" else LARGE)
    y = norm.normalize(M.to(getattr(torch, dtype)))
    assert y.isfinite().all() and y[:, : PEAKS.start].abs().max() <= 4


@often
@given(seeds, st.sets(st.sampled_from(sorted(BLOCKS))))
def test_unheard_blocks_say_nothing(seed, blocks):
    norm = MusicNormalizer.fit([data(seed, 20, 35, 0.0)])
    masked, M = norm.without(blocks), data(seed + 1, 9, 35, 0.0)
    hidden = torch.zeros(35, dtype=torch.bool)
    for name in blocks:
        hidden[BLOCKS[name]] = True
    y = masked.normalize(M)
    assert (y[:, hidden].abs() < 1e-4).all()
    assert torch.equal(y[:, ~hidden], norm.normalize(M)[:, ~hidden])
