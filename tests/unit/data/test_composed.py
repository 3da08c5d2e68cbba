"""Composed groups: real movement, nobody collides, nothing leaks."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import torch

from dancediff.data.augment import rotate_features, shift_features
from dancediff.data.cmu import cmu_jobs
from dancediff.data.composed import (
    MIN_DISTANCE,
    WAYS,
    composed_jobs,
    copies,
    distance_between,
    make_composed,
    two_duets,
)
from dancediff.data.prepare import prepare
from dancediff.data.prepared import PreparedData
from dancediff.data.soundtrack import with_soundtrack
from dancediff.data.take import DanceTake, Job
from dancediff.data.take_file import write_take
from dancediff.motion.contact import foot_contact
from dancediff.motion.mirror import mirror_features
from dancediff.motion.motion import Motion
from dancediff.motion.rotation import rotation_about


def walk(seed, n=1, frames=260, size=0.5):
    """Dancers who walk in circles and turn; a duet keeps half a metre between its partners."""
    rng = np.random.default_rng(seed)
    u = torch.arange(frames) / 30 * float(rng.uniform(0.8, 1.4)) + float(rng.uniform(0, 6))
    root = torch.stack([size * u.cos(), 0.9 + 0.05 * (4 * u).sin(), size * u.sin()], -1).repeat(
        n, 1, 1
    )
    root[..., 0] += 0.5 * torch.arange(n)[:, None]
    pose = torch.eye(3).repeat(n, frames, 24, 1, 1)
    pose[:, :, 0] = rotation_about("y", u)
    pose[:, :, 16] = rotation_about("z", (2 * u).sin())  # only the left arm: mirrors differ
    return Motion(pose, root)


def take(name, seed, n, split, group=None):
    return DanceTake(name, walk(seed, n), "real", "none", "mocap", "free", split, group or name)


def floor(motion):
    return motion.root[..., (0, 2)]


@pytest.mark.parametrize("seed", range(5))
def test_two_duets_share_a_stage_and_stay_themselves(seed):
    a, b = walk(1, 2, 300), walk(2, 2)
    motion, how = two_duets(a, b, np.random.default_rng(seed))
    assert motion.num_dancers == 4 and motion.num_frames == 260
    x = motion.features()
    assert distance_between(x[:2], x[2:]) >= MIN_DISTANCE
    assert distance_between(x[:2], x[2:]) < 1.0  # and not a mile apart
    start = how["starts"][0]
    for part, source in ((motion.root[:2], a.frames(start, start + 260)), (motion.root[2:], b)):
        between = (part[0] - part[1]).norm(dim=-1)
        assert torch.allclose(between, (source.root[0] - source.root[1]).norm(dim=-1), atol=1e-4)
    assert torch.allclose(motion.pose[2:, :, 16], b.pose[:, :, 16], atol=1e-5)  # arms are theirs
    assert floor(motion).mean((0, 1)).norm() < 1e-4


@pytest.mark.parametrize(("n", "way"), list(itertools.product((3, 4, 5), WAYS)))
def test_copies_keep_apart_and_are_copies(n, way):
    solo = walk(3)
    motion, how = copies(solo, n, way, np.random.default_rng(n))
    assert motion.num_dancers == n
    pairs = itertools.combinations(floor(motion), 2)
    assert min((a - b).norm(dim=-1).min() for a, b in pairs) >= MIN_DISTANCE
    mirrored = Motion.from_features(mirror_features(solo.features()))
    f, last = motion.num_frames, max(how["late"])
    for k in range(n):
        source = mirrored if how["mirrored"][k] else solo
        start = last - how["late"][k]
        expected = source.pose[0, start : start + f]
        assert torch.allclose(motion.pose[k], expected, atol=1e-5)
    assert (len(set(how["late"])) == n) == (way == "canon")
    assert any(how["mirrored"]) or way != "mirror"
    assert (floor(motion).mean(1)[:, 0].diff() > 0).all() or way != "unison"  # slots, left to right


def test_copies_that_would_meet_are_spread_or_refused():
    def stretched(size, seed=0):
        solo = walk(3, frames=400, size=size)
        return copies(solo, 5, "canon", np.random.default_rng(seed))[1]["stretched"]

    assert stretched(0.1) == 1.0 < stretched(1.0)
    with pytest.raises(ValueError, match="no formation keeps 5 copies"):
        stretched(3, seed=2)
    with pytest.raises(ValueError, match="less than 150"):
        copies(walk(3, frames=155), 4, "canon", np.random.default_rng(0))
    with pytest.raises(ValueError, match="way='chaos'"):
        copies(walk(3), 3, "chaos", np.random.default_rng(0))
    side = torch.arange(-8, 8, 0.6)
    grid = torch.cartesian_prod(side, torch.tensor([0.9]), side)  # people all over the place
    crowd = Motion(torch.eye(3).expand(len(grid), 2, 24, 3, 3), grid[:, None].repeat(1, 2, 1))
    with pytest.raises(ValueError, match="cannot be kept"):
        two_duets(crowd, walk(2, 2), np.random.default_rng(0))


def test_contacts_are_those_of_the_new_stage():
    solo = walk(3)
    solo.contact = torch.full((1, 260, 4), 0.5)
    motion, _ = copies(solo, 3, "unison", np.random.default_rng(0))
    assert torch.equal(motion.contact, foot_contact(motion.joints()))


def test_the_check_is_not_skipped(tmp_path):
    (tmp_path / "takes").mkdir()
    path = write_take(tmp_path / "takes" / "s.npz", take("s", 1, 1, "train"))
    heap = Motion.from_features(walk(3).features().repeat(3, 1, 1))
    with pytest.raises(ValueError, match=r"within 0\.00 m"):
        make_composed("x", [path], lambda solo, rng: (heap, {}), recipes=[], songs=1)


def test_jobs_stay_within_splits_and_say_where_they_come_from(tmp_path):
    real = [take(f"d{k}", k, 2, "train") for k in range(3)]
    real += [take("v1", 7, 2, "val"), take("v2", 8, 2, "val"), take("only", 9, 2, "test")]
    real += [take("s", 4, 1, "train"), take("sv", 5, 1, "val", group="a song")]
    prepare([Job(t.name, Again(t)) for t in real], tmp_path, progress=False)
    jobs = composed_jobs(tmp_path, songs=1)
    pairs = {job.name for job in jobs if job.name.startswith("pair")}
    assert pairs == {"pair_d0_d1", "pair_d1_d2", "pair_d2_d0", "pair_v1_v2"}
    assert len(jobs) == 4 + 2 * 3
    summary = prepare([job for job in jobs if job.name[-1] in "2v"], tmp_path, progress=False)
    assert summary.skipped == {} and summary.made == 5
    data = PreparedData(tmp_path)  # which refuses what leaks
    entry = data.by_name["pair_d1_d2"]
    assert (entry.kind, entry.split, entry.groups) == ("composed", "train", ["d1", "d2"])
    assert entry.file == "composed/pair_d1_d2.npz" and entry.music == "beat-aligned synthetic"
    assert entry.notes["made_from"] == ["d1", "d2"] and entry.notes["min_distance"] >= MIN_DISTANCE
    for entry in data:
        if entry.kind == "composed":
            assert entry.licence == "free" and entry.source.startswith("composed of ")
            for name in entry.notes["made_from"]:
                assert data.by_name[name].split == entry.split
    copy = next(e for e in data if e.name.endswith("_sv"))
    assert copy.group == "a song" and copy.split == "val" and copy.dancers in (3, 4, 5)


def test_parts_from_two_places_bring_their_licences_and_sources(tmp_path):
    """Only those of the first were kept, and its genre."""
    ours = replace(take("a", 1, 2, "train"), genre="salsa")
    theirs = replace(take("b", 2, 2, "train"), source="theirs", licence="CC-BY-4.0")
    again = replace(take("c", 3, 2, "train"), genre="salsa")
    prepare([Job(t.name, Again(t)) for t in (ours, theirs, again)], tmp_path, progress=False)
    made = {job.name: job.make() for job in composed_jobs(tmp_path, songs=1)}
    ab, ca = made["pair_a_b"], made["pair_c_a"]
    assert (ab.licence, ab.genre) == ("free AND CC-BY-4.0", None)
    assert ab.source == "composed of a + b; mocap + theirs"
    assert (ca.licence, ca.genre, ca.source) == ("free", "salsa", "composed of c + a; mocap")


def test_what_people_danced_to_a_recording_is_not_composed(tmp_path):
    """Else its song would be replaced; with silent ones in one folder all were."""
    silent = [take("a", 1, 2, "train"), with_soundtrack(take("b", 2, 2, "train"), songs=1)]
    heard = [
        replace(take(f"{music}_{n}", n, n, "train"), music=music, M=torch.rand(260, 35))
        for music in ("original", "recorded")
        for n in (1, 2)
    ]
    prepare([Job(t.name, Again(t)) for t in silent + heard], tmp_path, progress=False)
    assert [job.name for job in composed_jobs(tmp_path)] == ["pair_a_b"]


def test_real_dancers_do_not_collide(real_data):
    if not (real_data / "cmu" / "manifest.json").is_file():
        pytest.skip(f"no cmu/manifest.json in {real_data}")
    jobs = {job.name: job for job in cmu_jobs(real_data / "cmu")}
    a, b, solo = (jobs[name].make().motion for name in ("salsa_02", "salsa_13", "indian_06"))
    made = [(two_duets(a, b, np.random.default_rng(0))[0], 2)]
    made += [
        (copies(solo, n, way, np.random.default_rng(n))[0], 1)
        for n, way in ((3, "mirror"), (5, "canon"))
    ]
    for motion, together in made:
        for i, j in itertools.combinations(range(motion.num_dancers), 2):
            gap = (floor(motion)[i] - floor(motion)[j]).norm(dim=-1).min()
            assert gap >= MIN_DISTANCE or i // together == j // together


class Again:
    """A job that hands out a take."""

    def __init__(self, take):
        self.take = take

    def __call__(self):
        return self.take


def test_rotating_is_rotating_the_world():
    motion = walk(2, 2)
    turned = Motion.from_features(rotate_features(motion.features(), 0.7))
    expected = motion.joints() @ rotation_about("y", torch.tensor(0.7)).T
    assert torch.allclose(turned.joints(), expected, atol=1e-5)
    x = motion.features()
    back = rotate_features(rotate_features(x, 1.1), -1.1)
    assert torch.allclose(back, x, atol=1e-5)
    assert torch.equal(shift_features(x, 0, 0), x)
