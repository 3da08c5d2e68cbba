"""The packaged model's dances: what a viewer would notice first, without any post-processing.

One dance of three to the packaged song, the whole way (20 s, two seams a dancer pair has
to get through), and short ones for the rest. The bars are those a user is promised in docs/results.
"""

import pytest
import torch

import dancediff as dd
from dancediff.data.choreographed import choreograph_jobs
from dancediff.data.choreographer import choreograph
from dancediff.diffusion.conditions import Conditions
from dancediff.diffusion.schedule import q_sample
from dancediff.motion.contact import feet_low, foot_speed
from dancediff.music.synth import synth_song
from dancediff.papers.tcdiffpp.group_dance_decoder import FusionProjection

pytestmark = pytest.mark.slow

SHORT = {"seconds": 6, "steps": 8, "seed": 0}


@pytest.fixture(scope="module")
def model():
    return dd.load("tcdiffpp")


@pytest.fixture(scope="module")
def song():
    return dd.packaged_song()


@pytest.fixture(scope="module")
def dance(model, song):
    return model.generate(song, dancers=3, seconds=20, seed=1)


def speed(dance):
    """Mean over joints and frames, m/s."""
    return 30 * dance.joints().diff(dim=1).norm(dim=-1).mean().item()


def test_bodies_stay_between_floor_and_reach(dance):
    height = dance.joints()[..., 1]
    assert height.isfinite().all()
    assert height.min() > -0.05 and height.max() < 2.3


def test_no_root_jumps_not_even_at_seams(dance):
    assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.12


def test_dancers_keep_apart(dance):
    floor = dance.root[..., (0, 2)].transpose(0, 1)
    apart = torch.cdist(floor, floor) + 1e3 * torch.eye(3)
    assert (apart.flatten(1).amin(1) < 0.3).float().mean() < 0.01


def test_feet_stand(dance):
    assert (dance.contact > 0.5).float().mean() > 0.3
    joints = dance.joints()
    low = feet_low(joints)
    assert (foot_speed(joints)[low] < 0.015).float().mean() > 0.9


def test_they_move_as_much_as_the_dances_it_learned_from(dance):
    jobs = choreograph_jobs(10, seconds=20.0, sizes=(3,))  # one of each genre
    learned = [speed(job.make().motion) for job in jobs]
    assert speed(dance) == pytest.approx(sum(learned) / 10, rel=0.3)


def test_same_seed_same_bits_other_seed_other_song_other_dance(model, song):
    first, again = (model.generate(song, dancers=2, **SHORT) for _ in range(2))
    assert torch.equal(first.root, again.root) and torch.equal(first.pose, again.pose)
    other_song, _ = synth_song(5, seconds=8.0)
    for other in (
        model.generate(song, dancers=2, **SHORT | {"seed": 1}),
        model.generate(other_song, dancers=2, **SHORT),
    ):
        assert (first.joints() - other.joints()).norm(dim=-1).mean() > 0.05


@pytest.mark.parametrize("dancers", [1, 5])
def test_every_group_size(model, song, dancers):
    dance = model.generate(song, dancers=dancers, **SHORT)
    assert dance.num_dancers == dancers and dance.joints().isfinite().all()
    start = dance.root[:, 0, 0]
    assert torch.equal(start, start.sort().values)


def test_no_part_of_the_fusion_projection_is_dead(model, song):
    """Units of its second layer that hear something: dances of all sizes, to music, five levels."""
    heard, model = [], model.model
    fusion = next(m for m in model.modules() if isinstance(m, FusionProjection))
    hook = fusion.middle.register_forward_hook(
        lambda _, __, out: heard.append((out > 0).flatten(0, -2).float().mean(0))
    )
    generator = torch.Generator().manual_seed(0)
    M = model.music_normalizer.normalize(song.features())
    for seed in range(12):
        n = 1 + seed % 5  # a unit may listen to some group sizes only
        dance, _ = choreograph(torch.arange(0.3, 5, 0.5).numpy(), dancers=n, seed=seed, seconds=5)
        x_0 = model.normalizer.normalize(dance.features())[None]
        part, S = M[None, 30 * seed : 30 * seed + 150], torch.randperm(n, generator=generator)
        for t in (20, 200, 500, 800, 999):
            noise = torch.randn(x_0.shape, generator=generator)
            x_t = q_sample(x_0, t, model.abar, noise).float()
            with torch.no_grad():
                model(x_t, torch.tensor([t]), Conditions(part, S[None]))
    hook.remove()
    active = torch.stack(heard)
    assert (active.amax(0) > 0).float().mean() > 0.9
    assert active.mean() > 0.02
