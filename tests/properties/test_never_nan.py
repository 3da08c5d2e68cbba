"""Valid but extreme input: one frame, one dancer, nobody moves, few digits, silence. No NaN."""

import math
from functools import lru_cache

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from dancediff.data.choreographer.formations import slots
from dancediff.diffusion.conditions import Conditions
from dancediff.extensions.beat_phase import beat_waves
from dancediff.extensions.build import EXTENSIONS, build
from dancediff.extensions.collision_avoidance import CollisionAvoidance
from dancediff.extensions.floor_contact import project_floor_contact
from dancediff.extensions.foot_contact_projection import foot_contact_hook, project_foot_contact
from dancediff.extensions.group_relations import Group
from dancediff.extensions.speed_limit import limit_travel, limit_turns
from dancediff.generation.pipeline import pipeline_of
from dancediff.metrics.collision import tif
from dancediff.metrics.fidelity import diversity, fid
from dancediff.metrics.formation import FORMATION
from dancediff.metrics.geometric import geometric_features
from dancediff.metrics.group import gmc, gmr, group_features
from dancediff.metrics.kinetic import kinetic_features
from dancediff.metrics.measure import beats_per_second, joint_speed
from dancediff.metrics.physical import below_floor, fsr, pfc
from dancediff.metrics.posture import POSTURE
from dancediff.metrics.report import evaluate
from dancediff.metrics.rhythm import beat_alignment
from dancediff.metrics.swaps import abrupt_swaps, final_order
from dancediff.motion.beats import mean_speed, motion_beats
from dancediff.motion.contact import foot_contact, foot_speed
from dancediff.motion.motion import Motion
from dancediff.motion.representation import LODGE, TCDIFFPP, Normalizer, joints_of
from dancediff.motion.rotation import (
    axis_angle_to_matrix,
    matrix_to_axis_angle,
    rot6d_to_matrix,
    rotation_between,
    slerp,
)
from dancediff.music.features import MusicNormalizer, music_features
from dancediff.music.song import Music
from dancediff.nn.losses import compare
from dancediff.papers.edge.model import EDGE, EDGEConfig
from dancediff.papers.lodge.losses import LodgeWeights, l_jacc, l_jvel, lodge_losses
from dancediff.papers.lodge.primitives import LAYOUT, Layout, primitives_of
from dancediff.papers.tcdiffpp.losses import (
    LossWeights,
    five_losses,
    l_vel,
    tcdiffpp_losses,
)
from dancediff.papers.tcdiffpp.model import TCDiffPP, TCDiffPPConfig
from dancediff.training.config import TrainingExtensions
from dancediff.training.extended_losses import extended_losses
from tiny_lodge import tiny_lodge

often = settings(deadline=None, derandomize=True, max_examples=40)
seeds = st.integers(0, 2**32 - 1)
counts = st.integers(1, 3)
frames = st.sampled_from([1, 2, 3, 4, 40])
dtypes = st.sampled_from([torch.float32, torch.float16, torch.bfloat16, torch.float64])
kinds = st.sampled_from(["still", "one place", "far", "wild", "sudden"])


def normal(seed, *shape):
    return torch.randn(shape, generator=torch.Generator().manual_seed(seed))


def dance(kind, seed, n, f, spec=TCDIFFPP, dtype=torch.float32):
    """Features (n, f, d) of dancers who stand, alone or in one place, or move as nobody can."""
    x = torch.zeros(n, f, spec.dim)
    x[..., spec.rot6d.start :: 6] = x[..., spec.rot6d.start + 4 :: 6] = 1
    x[..., spec.root] = torch.tensor([0.0, 0.93, 0.0])
    if kind != "one place":
        x[..., spec.root.start] += torch.arange(n)[:, None]
    if kind == "far":
        x[..., spec.root] += 10 if dtype == torch.float16 else 1e4  # it holds three digits
    if kind == "wild":
        x = normal(seed, n, f, spec.dim)
    if kind == "sudden":  # half a turn about the spine, and somewhere else, within a frame
        x[:, f // 2 :, spec.rot6d.start] = -1
        x[:, f // 2 :, spec.root.start] += 5
    return x.to(dtype)


def finite(value):
    if isinstance(value, dict):
        return all(map(finite, value.values()))
    if isinstance(value, (tuple, list)):
        return all(map(finite, value))
    if isinstance(value, Motion):
        return finite([value.pose, value.root, value.joints()])
    if isinstance(value, (float, int)):
        return math.isfinite(value)
    return bool(torch.as_tensor(value).isfinite().all())


@often
@given(kinds, seeds, counts, frames, dtypes, st.sampled_from([TCDIFFPP, LODGE]))
def test_features_joints_and_contacts(kind, seed, n, f, dtype, spec):
    x = dance(kind, seed, n, f, spec, dtype)
    joints = joints_of(x, spec)
    assert joints.dtype == dtype and finite(joints)
    assert finite([foot_contact(joints), foot_speed(joints), beat_waves(normal(seed, n, f, 35))])
    if dtype != torch.bfloat16:  # numpy does not know it
        assert finite([mean_speed(joints[0]), motion_beats(joints[0])])
    motion = Motion.from_features(x, name=spec.name)
    assert finite([motion, motion.features(), motion.features("lodge"), motion.contact])
    assert finite([motion.frames(0, 1), motion.dancer(n - 1), motion.seconds(0, 0.04)])


@often
@given(seeds, dtypes, st.floats(0, math.pi), st.floats(-2, 2))
def test_rotations(seed, dtype, angle, size):
    # no zeros and no parallel rows among these
    v = torch.nn.functional.normalize(normal(seed, 20, 3), dim=-1)
    a, b = v.to(dtype), v.roll(1, 0).to(dtype)
    R = axis_angle_to_matrix((angle * v).to(dtype))
    assert finite([R, matrix_to_axis_angle(R), rot6d_to_matrix(torch.cat([a, b * 10**size], -1))])
    assert finite([rotation_between(a, b), rotation_between(a, a), rotation_between(a, -a)])
    assert finite(slerp(R, R.flip(0), torch.linspace(0, 1, 20, dtype=dtype)))
    assert finite(slerp(R, R, torch.linspace(0, 1, 20, dtype=dtype)))


@settings(often, max_examples=25)
@given(kinds, seeds, counts, frames, dtypes, st.booleans())
def test_what_bodies_cannot_do_is_taken_out(kind, seed, n, f, dtype, solo):
    spec = LODGE if solo else TCDIFFPP
    x = dance(kind, seed, n, f, spec, dtype)
    for mend in (limit_turns, limit_travel, project_floor_contact, project_foot_contact):
        assert finite(mend(x, None, spec)), mend.__name__
    if kind == "sudden" and f > 2 and dtype == torch.float32:
        step = limit_travel(x, None, spec)[..., spec.floor].diff(dim=-2).norm(dim=-1)
        assert step.max() < x[..., spec.floor].diff(dim=-2).norm(dim=-1).max()
    fixed = torch.rand(n, f, generator=torch.Generator().manual_seed(seed)) < 0.5
    norm = Normalizer(-torch.ones(spec.dim), torch.ones(spec.dim))
    assert finite(foot_contact_hook(norm, fixed[..., None].expand(x.shape), spec).apply(x, 0.9))
    if not solo and dtype == torch.float32:
        asked = CollisionAvoidance(norm).at(x, 0.9)
        assert asked is None or finite([asked.value, asked.slack])


METRICS = {  # and what they know of published forms
    kinetic_features: (None, "lodge", "aist", "gcd"),
    geometric_features: (None, "lodge", "aist"),
    group_features: (None, "gcd"),
    gmc: (None, "gcd"),
    pfc: (None,),  # "edge" is NaN for who never moves, and says so
    fsr: (None, "lodge"),
}


@often
@given(
    kinds, seeds, counts, frames, dtypes, st.sampled_from([24, 22]), st.sampled_from([1, 30, 60])
)
def test_metrics_of_a_dance(kind, seed, n, f, dtype, body, fps):
    joints = joints_of(dance(kind, seed, n, f, TCDIFFPP, dtype))[:, :, :body]
    calls = [
        (f"{metric.__name__} {compat}", lambda m=metric, c=compat: m(joints, fps=fps, compat=c))
        for metric, forms in METRICS.items()
        for compat in forms
    ]
    for direction in ("music", "motion"):
        beats = {"beats": [0.0], "direction": direction, "fps": fps}
        calls.append((direction, lambda how=beats: beat_alignment(joints, **how)))
    calls += [("speed", lambda: joint_speed(joints, fps=fps)), ("tif", lambda: tif(joints))]
    calls += [("below", lambda: below_floor(joints, fps=fps))]
    calls += [("beats", lambda: beats_per_second(joints, fps=fps))]
    for name, compute in calls:
        try:
            assert finite(compute()), name
        except ValueError as err:
            off_floor = "fsr" in name and "floor" in str(err)
            enough = f >= 3 and n >= 2 and (body == 24 or name != "tif")
            assert off_floor or not enough, name
            assert off_floor or "joints has" in str(err)


@settings(often, max_examples=25)
@given(
    kinds, seeds, counts, st.sampled_from([1, 7, 100]), dtypes, st.sampled_from([24, 22]),
    st.sampled_from([1, 30, 60]),
)  # fmt: skip
def test_posture_and_formations_of_a_dance(kind, seed, n, f, dtype, body, fps):
    joints = joints_of(dance(kind, seed, n, f, TCDIFFPP, dtype))[:, :, :body]
    frames_for = {"turning": max(1, round(fps / 2)) + 1, "stillness": 2, "standing": 3 * fps}
    for name, (metric, _) in (POSTURE | FORMATION).items():
        dancers = 3 if name == "hull area" else 2 if name in FORMATION else 1
        try:
            assert finite(metric(joints, fps=fps)), name
        except ValueError as err:
            assert "joints has" in str(err), name
            assert n < dancers or f < frames_for.get(name, 1), f"{name} refuses what is enough"


@often
@given(kinds, seeds, counts, frames)
def test_a_report_gives_a_number_or_the_reason(kind, seed, n, f):
    motion = Motion.from_features(dance(kind, seed, n, f))
    rows = evaluate(motion, [0.0]).rows
    assert len(rows) > 5
    for row in rows:
        assert math.isfinite(row.value) or row.reason, row.name
    if f > 2 and n > 1:
        assert {"GMC", "TIF", "PFC", "BAS"} <= {row.name for row in rows if finite(row.value)}
    assert finite(final_order(motion.root))
    if f > 1:
        assert finite([swap.metres for swap in abrupt_swaps(motion.root)])


@often
@given(seeds, st.integers(2, 6), st.integers(1, 9), dtypes, st.sampled_from([0.0, 1e-9, 1, 1e6]))
def test_distances_of_sets_that_hardly_vary(seed, count, d, dtype, size):
    size = min(size, 1e3) if dtype == torch.float16 else size
    x, reference = ((size * normal(seed + k, count, d) + 1).to(dtype) for k in (0, 1))
    reference[:, 0] = 1  # never changes
    for compat in (None, "lodge", "aist", "gcd"):
        assert finite([fid(x, reference, compat=compat), diversity(x, reference, compat=compat)])
        assert finite(fid(reference, reference, compat=compat))
    assert finite(gmr(x, reference))


@often
@given(kinds, kinds, seeds, counts, st.sampled_from([2, 3, 20]), dtypes)
def test_losses(kind, other, seed, n, f, dtype):
    x_0, x_hat = (dance(k, seed + i, n, f)[None] for i, k in enumerate((kind, other)))
    if dtype == torch.float16:  # its largest number is 65504, less than the square of 1e4
        x_0, x_hat = x_0.clamp(-5, 5), x_hat.clamp(-5, 5)
    x_0, x_hat = x_0.to(dtype), x_hat.to(dtype).requires_grad_()
    one = torch.ones(151)
    on = TrainingExtensions(
        both_guesses=True, hard_contact=True, joint_velocity_loss=0.1, slide_loss=0.1
    )
    for extensions in (on, TrainingExtensions()):
        terms = extended_losses(
            compare(x_hat, x_hat, x_0, Normalizer(-one, one)),
            five_losses,
            LossWeights().terms(),
            extensions=extensions,
            reconstruction="simple",
        )
        assert finite({name: value.detach() for name, value in terms.items()})
        (gradient,) = torch.autograd.grad(terms["total"], x_hat)
        assert finite(gradient)


@often
@given(kinds, kinds, seeds, counts, st.sampled_from([3, 8, 20]))
def test_losses_of_lodge(kind, other, seed, n, f):
    x_0, x_hat = (dance(k, seed + i, n, f, LODGE) for i, k in enumerate((kind, other)))
    x_hat.requires_grad_()
    norm = Normalizer(-torch.ones(139), torch.ones(139))
    for weights in (LodgeWeights.coarse(), LodgeWeights.local(), LodgeWeights.fine_tune()):
        terms = lodge_losses(x_hat, x_0, norm, weights=weights)
        assert finite({name: value.detach() for name, value in terms.items()})
        assert finite(torch.autograd.grad(terms["total"], x_hat)[0])


@settings(often, max_examples=15)
@given(kinds, seeds, st.sampled_from([torch.float32, torch.float16, torch.bfloat16]))
def test_primitives_and_groups_of_a_solo(kind, seed, dtype):
    layout = Layout(128, 64)
    x = dance(kind, seed, 1, 128, LODGE, dtype)[0]
    primitives, at = primitives_of(x, layout=layout)
    assert primitives.shape == (layout.num_primitives, LAYOUT.length, LODGE.dim)
    assert finite(primitives) and at.min() >= 0 and at.max() < 128
    for relation in ("unison", "mirror", "canon"):
        for f in (1, 2, 128):
            options = {"delay": [0, 60]} if relation == "canon" else {}
            group = Group(x.float()[:f], slots(2, "line"), relation, **options).frames(0, f)
            assert group.shape == (2, f, LODGE.dim) and finite(group)


@settings(often, max_examples=25)
@given(kinds, seeds, st.sampled_from([1, 2, 5]), st.sampled_from([1, 24, 30, 120]))
def test_files_of_a_short_dance_and_back(tmp_path_factory, kind, seed, f, fps):
    motion = Motion.from_features(dance(kind, seed, 1, f), fps=fps)
    folder = tmp_path_factory.mktemp("files")
    suffixes = ["npz", "bvh", "smpl.npz"]
    if pytest.importorskip("pygltflib", reason='needs pip install "dancediff[gltf]"'):
        suffixes.append("glb")
    for suffix in suffixes:
        again = Motion.load(motion.save(folder / f"dance.{suffix}"))
        assert again.num_frames == f and again.fps == pytest.approx(fps, rel=1e-3), suffix
        assert finite(again), suffix
        torch.testing.assert_close(again.joints(), motion.joints(), atol=2e-3, rtol=1e-6)


def tone(kind, count):
    """Sounds at the edge of what is one."""
    return {
        "nothing": np.zeros(count),
        "next to nothing": np.full(count, 1e-38),
        "constant": np.ones(count),
        "click": np.eye(1, count, count // 2)[0],
        "noise": np.random.default_rng(0).normal(size=count),
        "thunder": 1e12 * np.random.default_rng(0).normal(size=count),
    }[kind].astype(np.float32)


@pytest.mark.parametrize("kind", ["nothing", "next to nothing", "constant", "click", "noise",
                                  "thunder"])  # fmt: skip
def test_music_of_every_kind_has_features(kind):
    for count in (1, 2, 511, 512, 15360):
        sound = tone(kind, count)
        M = music_features(sound)
        assert M.shape == (1 + count // 512, 35) and np.isfinite(M).all()
        song = Music(sound, 15360)
        assert finite([song.features(), song.peak, song.duration])
        assert song.is_silent == (sound.max() < 1e-4)
        assert math.isfinite(song.tempo) or len(song.beats()) < 2


TINY = {"d_model": 8, "num_heads": 1, "num_layers": 1, "ff_dim": 8}


@lru_cache
def tiny(kind):
    torch.manual_seed(0)
    if kind == "EDGE":
        return pipeline_of(EDGE(EDGEConfig(**TINY, num_frames=30)).eval())
    if kind == "Lodge":
        return pipeline_of(tiny_lodge())
    sizes = {"fusion_hidden": 8, "footwork_hidden": 8, "num_frames": 30}
    config = TCDiffPPConfig(**TINY, **sizes)
    return pipeline_of(build(TCDiffPP, config, EXTENSIONS[TCDiffPP]).eval())


@pytest.mark.parametrize("kind", ["TCDiffPP", "EDGE", "Lodge"])
@pytest.mark.parametrize("sound", ["nothing", "next to nothing"])
def test_nobody_dances_to_silence(kind, sound):
    song = Music(tone(sound, 2 * 15360), 15360, "pause")
    options = {} if kind == "Lodge" else {"overlap": 10}
    with pytest.raises(ValueError, match="'pause' is silent"):
        tiny(kind).generate(song, **options)


class Song:
    """Two seconds of anything."""

    name, duration, is_silent, tempo = "anything", 2.0, False, float("nan")

    def __init__(self, size):
        self.M = size * normal(0, 61, 35)

    def features(self):
        return self.M


@often
@given(
    st.sampled_from([0.0, 1e-9, 1, 1e6]),
    st.floats(1 / 30, 2),
    st.integers(1, 5),
    st.sampled_from(["dpm", "ddim"]),
    st.sampled_from([None, torch.bfloat16]),
    seeds,
)
def test_an_untrained_model_dances_to_anything(size, seconds, dancers, sampler, dtype, seed):
    options = {"seconds": seconds, "seed": seed, "steps": 2, "sampler": sampler, "overlap": 10}
    model = tiny("TCDiffPP")
    motion = model.generate(Song(size), dancers=dancers, guidance=2.0, dtype=dtype, **options)
    assert motion.num_frames == round(30 * seconds)
    assert finite(motion) and finite(motion.contact)


@often
@given(
    seeds,
    st.sampled_from([0.0, 1e-20, 1, 1e4]),
    st.sampled_from([0.0, 1e-20, 1, 1e4]),
    st.sampled_from([0, 500, 999]),
    st.sampled_from([torch.float32, torch.float16, torch.bfloat16]),
    st.integers(1, 3),
    st.sampled_from([1, 2, 30]),
)
@torch.no_grad()
def test_a_network_answers_to_anything(seed, size, loudness, t, dtype, n, f):
    x_t, M = size * normal(seed, 1, n, f, 151), loudness * normal(seed + 1, 1, f, 35)
    M = tiny("TCDiffPP").model.music_normalizer.normalize(M)
    conditions = Conditions(M, torch.arange(n)[None])
    with torch.autocast("cpu", dtype, enabled=dtype != torch.float32):
        if dtype != torch.float16 or size <= 1:
            assert finite(list(tiny("TCDiffPP").model(x_t, torch.tensor([t]), conditions)))


def test_nothing_comes_of_nothing():
    """Of one frame no change can be wrong; zero or parallel rows stay finite in half, too."""
    one, zero = torch.ones(1, 1, 1, 151), torch.zeros(1, 1, 1, 151)
    assert l_vel(one, zero) == 0
    terms = tcdiffpp_losses(one, one, zero, Normalizer(-torch.ones(151), torch.ones(151)))
    assert all(value.isfinite() for value in terms.values())
    joints = torch.zeros(1, 1, 24, 3)
    for loss in (l_jvel, l_jacc):
        assert loss(joints, joints) == 0
    for d6 in (torch.zeros(6), torch.tensor([1.0, 0, 0, 2, 0, 0])):
        assert rot6d_to_matrix(d6.half()).isfinite().all()
    assert MusicNormalizer.fit([torch.zeros(1, 35)]).std.isfinite().all()
    assert len(motion_beats(torch.randn(40, 24, 3).bfloat16()))
