"""The same dance again: in another process, after other work, alone or among others."""

import os
import subprocess
import sys

import numpy as np
import pytest
import torch

from dancediff import hub
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.samplers import SamplerOptions, sample
from dancediff.extensions.foot_contact_projection import foot_contact_hook
from dancediff.generation.guided_denoiser import GuidedDenoiser
from dancediff.generation.request import TCDiffPPRequest
from dancediff.generation.segmented_dance import largest_guess

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]
LONG = os.environ.get("DANCEDIFF_TRUST") == "long"
MODELS = ("tcdiffpp", "lodge")


@pytest.mark.parametrize("name", MODELS)
def test_in_another_process_and_after_other_work(name, tmp_path, record_property):
    words = ["packaged", "--model", name, "--seconds", "6", "--seed", "5", "--formats", "npz"]
    files = []
    for k in range(2):
        out = tmp_path / str(k)
        command = [sys.executable, "-m", "dancediff.cli", "generate", *words, "--out", str(out)]
        subprocess.run(command, check=True, capture_output=True)
        files.append((out / "dance.npz").read_bytes())
    assert files[0] == files[1]

    model, song = hub.load(name), hub.packaged_song()
    first = model.generate(song, seconds=6, seed=5)
    model.generate(song, seconds=3, seed=6, steps=3)
    torch.randn(7)
    np.random.default_rng().normal()
    again = model.generate(song, seconds=6, seed=5)
    for one, other in zip((first.pose, first.root), (again.pose, again.root), strict=True):
        assert torch.equal(one, other)
    record_property("trust", f"{name}, two processes, and after other work: the same bytes")


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5] if LONG else [3])
def test_a_group_dance_alone_and_among_others(n, record_property):
    """Four segments with their own music and noise, sampled apart and together."""
    model, b = hub.load("tcdiffpp").model, 4
    request = TCDiffPPRequest().resolve(model, hub.packaged_song())
    M = model.music_normalizer.normalize(hub.packaged_song().features())
    M = torch.stack([M[200 * k : 200 * k + 150] for k in range(b)])
    S = torch.arange(n).expand(b, n).contiguous()

    def danced(part: slice):
        push = (request.autoguidance, request.autoguidance_end)
        bind = GuidedDenoiser(model, 1.0, *push).bind
        seeds = range(b)[part]
        x = sample(
            bind(Conditions(M[part], swap=S[part])),
            (len(seeds), n, 150, 151),
            SamplerOptions(
                model.abar,
                request.sampler,
                request.steps,
                eta=request.eta,
                clamp=largest_guess(model, request),
            ),
            generator=[torch.Generator().manual_seed(k) for k in seeds],
            hooks=[foot_contact_hook(model.normalizer.on_cpu())],
        )
        return model.normalizer.unnormalize(x)

    with torch.inference_mode():
        together = danced(slice(b))
        apart = max((danced(slice(k, k + 1))[0] - together[k]).abs().max().item() for k in range(b))
        others = (together[0] - together[1]).abs().max().item()
    record_property(
        "trust", f"tcdiffpp, {n} dancers, alone or in a batch of {b}: at most {apart:.1e} apart"
    )
    assert apart < 1e-5 < others


def test_a_long_dance_in_one_piece_and_in_small_ones(record_property):
    model, song = hub.load("lodge"), hub.packaged_song()
    one, all_ = (model.generate(song, seed=3, at_once=k).features() for k in (1, None))
    apart = (one - all_).abs().max().item()
    record_property("trust", f"lodge, segments alone or together: at most {apart:.1e} apart")
    assert apart < 1e-5
