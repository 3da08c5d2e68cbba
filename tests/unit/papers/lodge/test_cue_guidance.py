from dataclasses import replace

import pytest
import torch

from dancediff.diffusion.samplers import SamplerOptions, sample, sampling_times
from dancediff.diffusion.schedule import cosine_abar, gaussian
from dancediff.motion.representation import LODGE
from dancediff.papers.lodge.cue_guidance import (
    CueGuidance,
    clean_borders,
    cue_channels,
    guided_steps,
)

ABAR = cosine_abar()
SAMPLERS = [("ddpm", 1000), ("ddim", 50), ("ddim", 100), ("ddim", 7), ("ddim", 4)]
SHARES = (0, 0.05, 0.25, 0.5, 0.75, 0.95, 1)  # Lodge Table 4


def gens(count, seed=0):
    return [torch.Generator().manual_seed(100 * seed + k) for k in range(count)]


def cues(segments=2, f=64, *, sampler="ddim", steps=10, **options):
    """Cues at both borders and at two places in between; every value is 0.8."""
    hard = torch.zeros(segments, f, dtype=torch.bool)
    hard[:, :4] = hard[:, -4:] = True
    soft = torch.zeros_like(hard)
    for k in range(segments):
        soft[k, 12 + k : 20 + k] = soft[k, 40:48] = True
    value = torch.full((segments, f, LODGE.dim), 0.8)
    times = sampling_times(sampler, steps)
    return CueGuidance(value, hard, soft, ABAR, times, **{"soft": 1.0} | options)


def dance(guidance, denoise=lambda x, t: 0.7 * x, *, seed=0, eta=1.0, sampler="ddim"):
    x_T = gaussian(guidance.y.shape, generator=gens(len(guidance.y), seed))
    return sample(
        denoise,
        guidance.y.shape,
        SamplerOptions(ABAR, sampler, len(guidance.times) - 1, eta=eta),
        generator=torch.Generator().manual_seed(seed),
        x_T=x_T,
        pin=guidance,
    )


def test_cues_speak_of_contacts_and_rotations():
    channels = cue_channels()
    assert channels[LODGE.contact].all() and channels[LODGE.rot6d].all()
    assert not channels[LODGE.root].any()


@pytest.mark.parametrize("steps", [4, 12, 30])
def test_few_step_sampler_is_guided_over_the_same_part_of_the_way(steps):
    times = sampling_times("dpm", steps)
    counts = [guided_steps(times, s) for s in SHARES]
    assert counts == sorted(counts) and counts[0] == 0 and counts[-1] == steps - 1
    for s, count in zip(SHARES, counts, strict=True):
        assert all(t >= (times[0] + 1) * (1 - s) - 1 for t in times[:count])


@pytest.mark.parametrize(("sampler", "steps"), SAMPLERS)
def test_share_of_steps_is_s(sampler, steps):
    times = sampling_times(sampler, steps)
    counts = [guided_steps(times, s) for s in SHARES]
    assert counts == sorted(counts) and counts[0] == 0 and counts[-1] == steps - 1
    for s, count in zip(SHARES[1:-1], counts[1:-1], strict=True):
        assert abs(count - s * steps) < 1


def test_steps_of_dpm_are_guided_over_the_same_part_of_the_way():
    """Its levels lie closer to the noise than to the dance, so these are fewer steps."""
    times = sampling_times("dpm", 20)
    held = [t for t in times if t + 1 > 993 * 0.25]
    assert guided_steps(times, 0.75) == len(held) == 11


def test_unevenly_spaced_steps_are_guided_over_the_same_part_of_the_way():
    few = [999, 900, 700, 300, 50, -1]
    assert [guided_steps(few, s) for s in (0, 0.05, 0.25, 0.5, 1)] == [0, 1, 2, 3, 4]


@pytest.mark.parametrize(("sampler", "steps"), SAMPLERS)
def test_pasting_follows_the_count(sampler, steps):
    for s in (0, 0.3, 1):
        guidance = cues(sampler=sampler, steps=steps, soft=s, generators=gens(2))
        x, touched = torch.zeros_like(guidance.y), 0
        for t_next in guidance.times[1:]:
            held = guidance(x, t_next)[:, 12:20, 10].abs().max() > 0
            assert bool(held) == guidance.guided(t_next)
            touched += int(held)
        assert touched == guided_steps(guidance.times, s)


def test_hard_cues_are_clean_at_every_step_and_from_the_start():
    guidance = cues()
    x = torch.randn_like(guidance.y)
    for y in (guidance.start(x), *(guidance(x, t) for t in guidance.times[1:])):
        assert torch.equal(y[guidance.hard], guidance.y[guidance.hard])
        assert torch.equal(y[..., LODGE.root], x[..., LODGE.root])
    assert torch.equal(guidance.start(x)[~guidance.hard], x[~guidance.hard])


def test_soft_cues_have_the_noise_of_the_step():
    guidance = cues(segments=40, f=64, steps=50, generators=gens(40))
    x = torch.zeros_like(guidance.y)
    for t_next in (979, 499, 19):
        held = guidance(x, t_next)[guidance.soft_only]
        a = float(ABAR[t_next])
        assert held.mean().item() == pytest.approx(0.8 * a**0.5, abs=0.01)
        assert held.std().item() == pytest.approx((1 - a) ** 0.5, rel=0.01)


def test_hard_and_soft_entries_of_one_segment():
    guidance = cues(segments=1, f=256)
    soft = torch.zeros(1, 256, dtype=torch.bool)
    for start in (28, 60, 156, 188):
        soft[:, start : start + 8] = True
    guidance = CueGuidance(guidance.y, guidance.hard_frames, soft, ABAR, guidance.times, soft=1.0)
    assert int((guidance.hard | guidance.soft_only).sum()) == (4 + 4 + 4 * 8) * 136 == 5440
    overlapping = CueGuidance(
        guidance.y, guidance.hard_frames, torch.ones_like(soft), ABAR, guidance.times, soft=1.0
    )
    assert not (overlapping.hard & overlapping.soft_only).any()


@pytest.mark.parametrize(("sampler", "steps"), [("ddim", 20), ("ddpm", 1000)])
def test_dance_obeys_hard_cues_and_leans_to_soft_ones_as_s_grows(sampler, steps):
    missed = []
    for s in (0, 0.5, 1):
        guidance = cues(sampler=sampler, steps=steps, soft=s, generators=gens(2, 1))
        x = dance(guidance, lambda x, t: 0.97 * x, sampler=sampler)
        assert torch.equal(x[guidance.hard], guidance.y[guidance.hard])
        missed.append((x - guidance.y)[guidance.soft_only].abs().mean().item())
    assert missed[0] > missed[1] > missed[2]


def test_s_zero_is_hard_cues_only():
    guidance = cues(soft=0, generators=gens(2))
    without = cues(generators=gens(2))
    without = replace(without, soft_frames=torch.zeros_like(without.soft_frames))
    assert torch.equal(dance(guidance), dance(without))


@pytest.mark.parametrize("segments", [1, 2, 7, 16])
def test_segments_apart_are_segments_together(segments):
    whole = cues(segments, generators=gens(segments, 5))
    x = dance(whole, eta=0.0, seed=3)
    whole.generators = gens(segments, 5)
    x_T = gaussian(whole.y.shape, generator=gens(segments, 3))
    for k in range(0, segments, 2):
        part = replace(
            whole,
            y=whole.y[k : k + 2],
            hard_frames=whole.hard_frames[k : k + 2],
            soft_frames=whole.soft_frames[k : k + 2],
            generators=whole.generators[k : k + 2],
        )
        y = sample(
            lambda x, t: 0.7 * x,
            part.y.shape,
            SamplerOptions(ABAR, "ddim", 10, eta=0.0),
            x_T=x_T[k : k + 2],
            pin=part,
        )
        torch.testing.assert_close(y, x[k : k + 2], atol=1e-5, rtol=0)


def test_borders_are_clean_where_cues_will_speak():
    x_t, x_0 = torch.randn(3, 256, 139), torch.randn(3, 256, 139)
    mixed = clean_borders(x_t, x_0)
    hard = cues(3, 256).hard
    assert torch.equal(mixed[hard], x_0[hard]) and torch.equal(mixed[~hard], x_t[~hard])


def test_borders_are_as_long_as_they_shall_be():
    mixed = clean_borders(torch.ones(1, 20, 139), torch.zeros(1, 20, 139), 3)
    assert (mixed[0, :, 7] == 0).nonzero().flatten().tolist() == [0, 1, 2, 17, 18, 19]


def test_input_is_not_written_to():
    guidance = cues(generators=gens(2))
    x = torch.randn_like(guidance.y)
    before = x.clone()
    guidance.start(x), guidance(x, guidance.times[1]), clean_borders(x, guidance.y)
    assert torch.equal(x, before)


def test_errors():
    for soft in (-0.1, 1.1):
        with pytest.raises(ValueError, match=f"soft={soft}"):
            cues(soft=soft)
    guidance = cues()
    with pytest.raises(ValueError, match="hard_frames has shape"):
        CueGuidance(
            guidance.y,
            guidance.hard_frames[:, 1:],
            guidance.soft_frames,
            ABAR,
            guidance.times,
            soft=1.0,
        )
    with pytest.raises(ValueError, match="x has shape"):
        guidance(torch.zeros(2, 63, 139), -1)
    with pytest.raises(ValueError, match="x_t has 8 frames; clean borders of 4 leave nothing"):
        clean_borders(torch.zeros(8, 139), torch.zeros(8, 139))
