"""The energy condition: unknown energy, a start that changes nothing, Lodge's tokens."""

import pytest
import torch

from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.build import build
from dancediff.extensions.energy_condition import DROP, EnergyCondition, with_dropped_energy
from dancediff.extensions.parts import Pass
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from tiny_lodge import tiny_lodge

TINY = {"d_model": 16, "num_layers": 1, "ff_dim": 32}
CONFIGS = {TCDiffPP: TCDiffPPConfig(**TINY, fusion_hidden=32), EDGE: EDGEConfig(**TINY)}
M, S = torch.randn(2, 20, 35), torch.arange(3).expand(2, 3)


def trained(part: EnergyCondition) -> EnergyCondition:
    """The part with random weights, as after training."""
    g = torch.Generator().manual_seed(0)
    for p in part.parameters():
        p.data.copy_(torch.randn(p.shape, generator=g))
    return part


def part_of(model) -> EnergyCondition:
    (part,) = (p for p in model.modules() if isinstance(p, EnergyCondition))
    return part


def test_unknown_is_none_nan_and_masked_music():
    part, e = trained(EnergyCondition(16)), torch.rand(2, 20)
    known = part.vectors(Conditions(M, energy=e), 20)
    without = part.vectors(Conditions(M), 20)
    assert without.shape == known.shape and (known != without).any(-1).all()
    some = e.clone()
    some[0, 5:9] = torch.nan
    made = part.vectors(Conditions(M, energy=some), 20)
    torch.testing.assert_close(made[0, 5:9], without[0, 5:9])
    torch.testing.assert_close(made[1], known[1])
    masked = Conditions(M, energy=e, music_mask=torch.tensor([False, True]))
    torch.testing.assert_close(part.vectors(masked, 20)[0], without[0])
    torch.testing.assert_close(part.vectors(masked, 20)[1], known[1])


def test_all_dancers_get_the_energy_of_their_frame():
    part, e = trained(EnergyCondition(16)), torch.rand(2, 20)
    run = Pass(None, None, Conditions(M, energy=e), None)
    group, solo = (
        part.tokens(torch.zeros(2, 3, 20, 16), run),
        part.tokens(torch.zeros(2, 20, 16), run),
    )
    torch.testing.assert_close(group, solo[:, None].expand(-1, 3, -1, -1))
    same = part.tokens(
        torch.zeros(2, 20, 16), Pass(None, None, Conditions(M, energy=e.flip(1)), None)
    )
    torch.testing.assert_close(same, solo.flip(1))


@pytest.mark.parametrize("kind", CONFIGS)
@pytest.mark.parametrize("names", [[], ["preconditioning", "beat_phase"]], ids=str)
def test_without_energy_the_guess_before_training_is_that_without_the_part(kind, names):
    plain = build(kind, CONFIGS[kind], names)
    model = build(kind, CONFIGS[kind], [*names, "energy_condition"])
    model.load_state_dict(plain.state_dict(), strict=False)
    x_t, t, e = torch.randn(2, 3, 20, 151), torch.tensor([10, 900]), torch.rand(2, 20)
    with torch.no_grad():
        without = plain.denoise(x_t, t, Conditions(M, S))
        same = model.denoise(x_t, t, Conditions(M, S))
        torch.testing.assert_close(same, without, atol=1e-6, rtol=1e-6)
        trained(part_of(model))
        away = (model.denoise(x_t, t, Conditions(M, S, energy=e)) - without).abs().amax(-1)
    assert (away > 1e-4).all()


def test_unknown_energy_leaves_no_nan_in_gradients():
    part = trained(EnergyCondition(16))
    e = torch.full((2, 20), torch.nan)
    e[0] = 0.5
    part.vectors(Conditions(M, energy=e), 20).sum().backward()
    assert all(p.grad.isfinite().all() for p in part.parameters())


def test_both_stages_of_lodge_listen_to_it():
    plain, model = tiny_lodge(), tiny_lodge([*tiny_lodge().extensions, "energy_condition"])
    model.load_state_dict(plain.state_dict(), strict=False)
    for old, stage in (
        (plain.global_stage, model.global_stage),
        (plain.local_stage, model.local_stage),
    ):
        c = stage.config
        frames = getattr(c, "music_frames", c.num_frames)
        x_t, t = torch.randn(1, c.num_frames, 139), torch.tensor([700])
        given = {"style": torch.randn(1, c.d_model)} if stage.style is not None else {}
        M, e = torch.randn(1, frames, 35), torch.rand(1, frames)

        with_energy, without = Conditions(M, energy=e, **given), Conditions(M, **given)
        with torch.no_grad():
            before = stage.denoise(x_t, t, without)
            plain_guess = old.denoise(x_t, t, without)
            torch.testing.assert_close(before, plain_guess, atol=1e-6, rtol=1e-6)
            trained(part_of(stage))
            away = stage.denoise(x_t, t, with_energy) - stage.denoise(x_t, t, without)
        assert away.abs().max() > 1e-3


def test_the_first_stage_gets_the_energy_of_its_tokens_frames():
    model = tiny_lodge(["preconditioning", "energy_condition"]).global_stage
    e = torch.arange(float(model.config.music_frames))[None]
    x_t = torch.zeros(1, model.config.num_frames, 139)
    given = Conditions(torch.zeros(1, e.shape[1], 35), energy=e)
    run = model.prepare(x_t, torch.tensor([5]), given)
    assert run.conditions.energy[0].tolist() == model.frames.long().tolist()


def test_another_length_is_refused():
    with pytest.raises(ValueError, match=r"energy has shape \(2, 9\); expected \(2, 20\)"):
        EnergyCondition(16).vectors(Conditions(M, energy=torch.rand(2, 9)), 20)


def test_a_share_of_rows_is_learned_without_its_energy():
    e = torch.rand(4000, 2)
    made = [with_dropped_energy(e, torch.Generator().manual_seed(s)) for s in (3, 3, 4)]
    gone = [one.isnan() for one in made]
    assert torch.equal(gone[0], gone[1]) and not torch.equal(gone[0], gone[2])
    assert torch.equal(gone[0][:, 0], gone[0][:, 1]), "a row as a whole"
    assert torch.equal(made[0][~gone[0]], e[~gone[0]])
    share = gone[0][:, 0].float().mean().item()
    assert abs(share - DROP) < 4 * (DROP * (1 - DROP) / 4000) ** 0.5
