"""Networks with any components and extensions: masked music and other rows do not matter."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import EXTENSIONS, build
from dancediff.extensions.registry import REGISTRY
from dancediff.papers.tcdiffpp.model import COMPONENTS, TCDiffPP, TCDiffPPConfig
from tiny_lodge import tiny_lodge

often = settings(deadline=None, derandomize=True, max_examples=30)
seeds = st.integers(0, 2**32 - 1)
TINY = {"d_model": 8, "num_heads": 2, "num_layers": 1, "ff_dim": 8}
MOST, FRAMES = 5, 12


def network_inputs(x):
    x_t, t, M, S = x
    return x_t, t, Conditions(M, S)


def normal(seed, *shape):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def close(a, b):
    """But for rounding: with random weights answers may be in the thousands."""
    atol = 1e-4 * (1 + b.abs().max().item())
    torch.testing.assert_close(a, b, atol=atol, rtol=0)


@st.composite
def switches(draw):
    """Any components left out, and any extensions that go together."""
    without = {name for name in COMPONENTS if draw(st.booleans())}
    names = {name for name in EXTENSIONS[TCDiffPP] if draw(st.booleans())}
    for _ in names.copy():  # what needs one that is left out is left out, too
        names = {name for name in names if names.issuperset(REGISTRY[name].needs)}
    if "formation_prior" in names:
        without -= {"dancer_positioning"}
    return sorted(without), sorted(names)


def loud(model, seed):
    """No part starts at zero here: what should not be seen would be."""
    generator = torch.Generator().manual_seed(seed)
    with torch.no_grad():
        for weight in model.parameters():
            weight.add_(torch.randn(weight.shape, generator=generator), alpha=0.1)
    return model.eval()


def group_model(seed, without, extensions):
    sizes = {"fusion_hidden": 16, "footwork_hidden": 8, "num_frames": FRAMES, "max_dancers": MOST}
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        config = TCDiffPPConfig(**TINY, **sizes, without=without)
        return loud(build(TCDiffPP, config, extensions), seed)


def group(seed, n, f, b=2):
    """Noisy motion, steps, music with beats, and a swap."""
    M = normal(seed + 1, b, f, 35)
    M[..., 33:] = (M[..., 33:] > 0.5).float()
    generator = torch.Generator().manual_seed(seed)
    t = torch.randint(0, 1000, (b,), generator=generator)
    S = torch.stack([torch.randperm(n, generator=generator) for _ in range(b)])
    return normal(seed, b, n, f, 151), t, M, S


@often
@given(switches(), seeds, st.integers(2, MOST), st.integers(1, FRAMES), st.data())
@torch.no_grad()
def test_without_dpe_and_fp_dancers_are_interchangeable(chosen, seed, n, f, data):
    without, extensions = chosen
    without = {*without, "dancer_positioning", "fusion_projection"}
    extensions = [name for name in extensions if name != "formation_prior"]
    model, (x_t, t, M, S) = group_model(seed, without, extensions), group(seed, n, f)
    order = data.draw(st.permutations(range(n)))
    for a, b in zip(
        model(x_t, t, Conditions(M, S)), model(x_t[:, order], t, Conditions(M, S)), strict=True
    ):
        close(a[:, order], b)


@often
@given(switches(), seeds, st.integers(1, MOST), st.integers(1, FRAMES))
@torch.no_grad()
def test_dropped_music_is_not_heard(chosen, seed, n, f):
    model, (x_t, t, M, S) = group_model(seed, *chosen), group(seed, n, f)
    keep = torch.tensor([True, False])
    other = M + 3 * normal(seed + 3, *M.shape)
    for a, b in zip(
        model(x_t, t, Conditions(M, S, music_mask=keep)),
        model(x_t, t, Conditions(other, S, music_mask=keep)),
        strict=True,
    ):
        assert torch.equal(a[1], b[1])
        assert not torch.equal(a[0], b[0])


@often
@given(switches(), seeds, st.integers(1, MOST), st.integers(1, FRAMES))
@torch.no_grad()
def test_groups_of_a_batch_do_not_meet(chosen, seed, n, f):
    model, given_ = group_model(seed, *chosen), group(seed, n, f, b=3)
    alone = model(*network_inputs(part[1:2] for part in given_))
    for a, b in zip(model(*network_inputs(given_)), alone, strict=True):
        close(a[1:2], b)


def solo_model(stage, seed, extensions, **chosen):
    first = {"music_frames": 64, "local_frames": 64}
    sizes = {"first": TINY | first, "second": TINY | {"num_frames": 64, "style_noise": 8}}
    sizes["first" if stage == "global_stage" else "second"] |= chosen
    with torch.random.fork_rng():
        return loud(getattr(tiny_lodge(extensions, **sizes), stage), seed)


@often
@given(st.booleans(), st.booleans(), seeds, st.booleans(), st.booleans())
@torch.no_grad()
def test_dropped_music_makes_no_difference_to_lodge(film, known, seed, switch, first):
    stage = "global_stage" if first else "local_stage"
    extensions = ["global_style"] + ["style_film"] * film + ["preconditioning"] * known
    extensions += ["beat_phase"] * switch + ["non_local_filter"] * (known and switch)
    chosen = {"variant": "discrete" if switch else "continuous"} if first else {}
    model = solo_model(stage, seed, extensions, **chosen)
    M = normal(seed, 3, 64, 35)
    M[..., 33:] = (M[..., 33:] > 0.5).float()
    x_t, style = normal(seed + 1, 3, model.config.num_frames, 139), normal(seed + 2, 3, 8)
    t, mask = torch.tensor([3, 500, 990]), torch.tensor([True, False, False])
    other = M + 3 * normal(seed + 3, *M.shape)

    def run(M, x_t=x_t):
        guess = model(x_t, t, Conditions(M, style=style, music_mask=mask))
        return guess if isinstance(guess, tuple) else (guess,)

    for a, b in zip(run(M), run(other), strict=True):
        assert torch.equal(a[1:], b[1:])
        assert not torch.equal(a[0], b[0])
    for a, b in zip(run(M), run(M, torch.cat([x_t[:2], -x_t[2:]])), strict=True):
        close(a[:2], b[:2])  # rows do not meet
        assert not torch.equal(a[2], b[2])
