"""The choreographer's bars, for every genre over a hundred seeds; its plan; its old call."""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import torch

import dancediff
from dancediff.data.choreographer import GENRES, choreograph
from dancediff.data.choreographer.footsteps import STILL
from dancediff.data.choreographer.formations import formation_names, min_distance, slots
from dancediff.data.choreographer.poses import ARM_POSES
from dancediff.motion.beats import motion_beats
from dancediff.motion.contact import CONTACT_HEIGHT, feet_low, foot_contact
from dancediff.motion.skeleton import FOOT_JOINTS, world_rotations

SEEDS, BEATS = 100, 10
SIZES = (1, 3, 1, 2, 5, 1, 3, 2, 1, 1)  # dancers, by seed


def grid(seed, tempo=(85, 145), seconds=12.0):
    rng = np.random.default_rng(seed)
    return np.arange(rng.uniform(0, 0.5), seconds, 60 / rng.uniform(*tempo))


@cache
def dances(name):
    """A hundred dances of one genre: every group size, all its tempi."""
    made = []
    seconds = round(BEATS * 60 / np.mean(GENRES[name].tempo), 1)
    for seed in range(SEEDS):
        beats = grid(seed, GENRES[name].tempo, seconds + 1)
        options = {
            "dancers": 4 if seed % 20 == 9 else SIZES[seed % 10],
            "seed": seed,
            "seconds": seconds,
            "genre": name,
        }
        dance, truth = choreograph(beats, **options)
        made.append((dance, truth, dance.joints()))
    return made


@pytest.fixture(params=list(GENRES))
def genre(request):
    return dances(request.param)


def test_planted_feet_stay_and_their_labels_are_exact(genre):
    low = torch.tensor(CONTACT_HEIGHT)
    for dance, truth, joints in genre:
        feet = joints[:, :, FOOT_JOINTS]
        step = feet.diff(dim=1).norm(dim=-1)
        planted = truth.contacts.bool()
        assert torch.equal(dance.contact, truth.contacts)
        assert planted.float().mean() > 0.3
        assert step[planted[:, :-1]].max() < 0.01
        # labelled is what is low and still, of the joints themselves; a hair's breadth is left open
        still = (step < STILL) & (feet[:, :-1, :, 1] < low)
        unsure = ((step - STILL).abs() < 1e-4) | ((feet[:, :-1, :, 1] - low).abs() < 2e-4)
        assert ((still == planted[:, :-1]) | unsure).all()
        assert feet_low(joints)[planted].all()


def test_who_stands_is_on_the_floor_and_nobody_is_below_it(genre):
    for _, truth, joints in genre:
        lowest = joints[..., 1].amin(-1)
        assert lowest.min() > -0.01 and joints[..., 1].max() < 2.9
        assert lowest[truth.contacts.amax(-1).bool()].max() < 0.03


def test_the_beat_can_be_seen_and_half_a_beat_later_it_cannot(genre):
    on, off = [], []
    for _, truth, joints in genre:
        half = int(np.diff(truth.beats).mean() / 2)
        inner = truth.beats[1:-1]
        for found in map(motion_beats, joints):
            on.append(np.mean([np.abs(found - b).min() <= 2 for b in inner]))
            off.append(np.mean([np.abs(found - b).min() <= 2 for b in inner + half]))
    assert np.quantile(on, 0.01) >= 0.7 and np.mean(on) > 0.9
    assert np.mean(off) < np.mean(on) - 0.4


def test_nobody_collides_and_nobody_jumps_through_space(genre):
    for dance, _, _ in genre:
        assert min_distance(dance.root[..., (0, 2)].numpy()) > 0.45
        assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.12


def test_truth_tells_order_and_formation(genre):
    for dance, truth, _ in genre:
        x = dance.root[..., 0].numpy()
        assert (np.diff(x[truth.order_start, 0]) > 0).all()
        assert (np.diff(x[truth.order_end, -1]) > 0).all()
        for frame, name, place in truth.formations[1:]:  # the first may just be left
            assert name in formation_names(dance.num_dancers)
            assert np.abs(dance.root[:, frame][:, (0, 2)].numpy() - place).max() < 0.75


@pytest.mark.parametrize("name", GENRES)
def test_same_seed_same_bits_other_seed_other_dance(name):
    a, b, c = (choreograph(grid(0), dancers=3, seed=s, genre=name)[0] for s in (4, 4, 5))
    assert torch.equal(a.pose, b.pose) and torch.equal(a.root, b.root)
    assert torch.equal(a.contact, b.contact)
    assert not torch.allclose(a.root, c.root, atol=0.05)


def test_the_old_call_is_the_same_as_ever():
    dance, truth = dancediff.choreograph(grid(1), dancers=2, seed=3)
    assert dance.num_dancers == 2 and truth.genre in GENRES
    assert dance.num_frames == round(grid(1)[-1] * 30)
    assert dance.meta == {
        "source": "choreographer", "seed": 3, "genre": truth.genre, "synthetic": True,
    }  # fmt: skip


def test_contacts_agree_with_the_rule_for_recorded_dances():
    for name in GENRES:
        agree = [(foot_contact(j) == t.contacts).float().mean().item() for _, t, j in dances(name)]
        assert np.mean(agree) > 0.88


def test_random_global_state_is_not_used():
    np.random.seed(0)  # noqa: NPY002 - the point of this test
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    torch_before = torch.get_rng_state()
    choreograph(grid(0), dancers=2, seed=0)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002
    assert torch.equal(torch.get_rng_state(), torch_before)


@pytest.mark.parametrize("n", range(1, 6))
def test_formations_have_a_left_to_right_order(n):
    for name in formation_names(n):
        place = slots(n, name)
        assert place.shape == (n, 2) and (np.diff(place[:, 0]) >= 0.3).all()
        assert min_distance(place[:, None]) > 0.75


@pytest.mark.parametrize("bad", [{"dancers": 0}, {"dancers": 6}, {"seconds": -1.0}])
def test_bad_arguments_are_named(bad):
    with pytest.raises(ValueError, match=f"{next(iter(bad))}={next(iter(bad.values()))}"):
        choreograph(grid(0), **bad)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"swap": [1, 0, 2]}, r"swap=\[1, 0, 2\] must be True .*False .*None"),
        ({"swap": "102"}, r"swap='102' must be True"),
        ({"seed": -1}, "seed=-1 must be an integer of at least 0"),
        ({"seed": 1.5}, "seed=1.5 must be an integer"),
        ({"dancers": 2.5}, "dancers=2.5 must be an integer"),
        ({"meter": 3.5}, "meter=3.5 must be an integer"),
        ({"genre": 3}, "genre=3 is unknown"),
    ],
)
def test_wrong_kinds_of_arguments_are_named_with_the_fix(bad, message):
    with pytest.raises(ValueError, match=message):
        choreograph(grid(0), **bad)


def test_a_genre_may_be_spelled_as_for_a_model():
    assert choreograph(grid(0, seconds=3), genre="Hip-Hop")[1].genre == "hiphop"


def test_bad_beats_genre_and_sections_are_named():
    with pytest.raises(ValueError, match="beats"):
        choreograph([0.0, 1.0, 0.5, 2.0])
    with pytest.raises(ValueError, match=r"beats='a.wav' is no list of times .* song.beats"):
        choreograph("a.wav")
    with pytest.raises(ValueError, match=r"genre='polka'.*salsa"):
        choreograph(grid(0), genre="polka")
    with pytest.raises(ValueError, match=r"sections.*verse"):
        choreograph(grid(0), sections=[(4.0, 2.0, "verse")])


def plan(monkeypatch, **options):
    """A dance, its truth, and the score behind it."""
    import importlib

    module = importlib.import_module("dancediff.data.choreographer.choreograph")
    kept, write = [], module.write_score
    monkeypatch.setattr(module, "write_score", lambda *a: kept.append(write(*a)) or kept[-1])
    dance, truth = choreograph(**options)
    return dance, truth, kept[-1]


SONG = [(0.0, 8.0, "verse"), (8.0, 16.0, "chorus"), (16.0, 24.0, "verse"), (24.0, 32.0, "chorus")]


def test_verse_and_chorus_differ_and_a_repeated_section_is_mirrored(monkeypatch):
    for seed, name in enumerate(GENRES):
        _, truth, score = plan(
            monkeypatch, beats=np.arange(0, 33, 0.5), dancers=1, seed=seed, genre=name,
            sections=SONG, seconds=32,
        )  # fmt: skip
        assert [s[2:] for s in truth.sections[-4:]] == [
            ("verse", False), ("chorus", False), ("verse", True), ("chorus", True),
        ]  # fmt: skip
        verse, chorus, again = (score.counts[0][k : k + 16] for k in (1, 17, 33))
        assert [c.move.name for c in verse] != [c.move.name for c in chorus]
        for before, after in zip(verse, again, strict=True):
            assert (before.move, before.within) == (after.move, after.within)
            assert not before.flip and after.flip


def test_a_repeated_phrase_is_the_mirror_image():
    """Seen in the joints: the second verse has left and right exchanged."""
    close = []
    for seed, name in enumerate(GENRES):
        beats = np.arange(0, 33, 0.5)
        dance, truth = choreograph(
            beats, dancers=1, seed=seed, genre=name, sections=SONG, seconds=32
        )
        start, stop = (next(s[0] for s in truth.sections if s[2:] == ("verse", m)) for m in (0, 1))
        a, b = (dance.joints()[0, at + 30 : at + 110] for at in (start, stop))
        a, b = (x - x[:, :1] for x in (a, b))
        swap = [
            0,
            2,
            1,
            3,
            5,
            4,
            6,
            8,
            7,
            9,
            11,
            10,
            12,
            14,
            13,
            15,
            17,
            16,
            19,
            18,
            21,
            20,
            23,
            22,
        ]
        image = b[:, swap] * torch.tensor([-1.0, 1.0, 1.0])
        same, other = ((a - x).norm(dim=-1).mean().item() for x in (b, image))
        close.append(other < 0.6 * same)
    assert np.mean(close) >= 0.8  # symmetric phrases look the same either way


def test_swap_is_obeyed():
    changed = []
    for seed in range(12):
        options = {"dancers": 3, "seed": seed, "seconds": 10}
        for swap in (True, False):
            _, truth = choreograph(grid(seed, (110, 120)), swap=swap, **options)
            if not swap:
                assert np.array_equal(truth.order_start, truth.order_end)
            else:
                changed.append(not np.array_equal(truth.order_start, truth.order_end))
    assert np.mean(changed) > 0.8


def test_by_default_every_order_comes():
    """Of three dancers: two exchanged in three ways, and both ways round."""
    ranks = set()
    for seed in range(30):
        _, truth = choreograph(grid(seed, (90, 120), 31), dancers=3, seed=seed, seconds=30)
        places = [place for _, _, place in truth.formations]
        for before, after in pairwise(places):
            rank = np.argsort(np.argsort(before[:, 0]))
            ranks.add(tuple(rank[np.argsort(after[:, 0])].tolist()))
    assert len(ranks) == 6


def test_turns_jumps_and_levels_are_danced():
    """The truth about turns and jumps is the body's: it goes round, and is off the floor."""
    turned, jumped = set(), set()
    for name in GENRES:
        levels = []
        for seed in range(4):
            tempo = GENRES[name].tempo
            dance, truth = choreograph(
                grid(seed, tempo, 41), dancers=1, seed=seed, seconds=40, genre=name
            )
            joints = dance.joints()
            front = dance.pose[:, :, 0, :, 2]
            yaw = np.unwrap(np.arctan2(front[..., 0].numpy(), front[..., 2].numpy()), axis=1)
            for i, start, stop, degrees in truth.turns:
                assert abs(np.degrees(yaw[i, stop] - yaw[i, start]) - degrees) < 70
                turned.add(name)
            for i, first, last in truth.jumps:
                assert (truth.contacts[i, first : last + 1] == 0).all()
                assert joints[i, (first + last) // 2, FOOT_JOINTS, 1].min() > 0.03
                jumped.add(name)
            height = dance.root[0, :, 1]
            levels.append(float(height.max() - height.min()))
        assert max(levels) > 0.06
    assert len(turned) >= 9 and len(jumped) >= 4


def test_relations_are_danced(monkeypatch):
    """Every relation is seen in what the dancers do in the phrase that has it."""
    seen = set()
    for seed in range(40):
        _, truth, score = plan(
            monkeypatch, beats=grid(seed, seconds=9), dancers=3, seed=seed, genre="house"
        )
        name = truth.relations[0][1]
        counts = [row[1] for row in score.counts]
        if counts[0].move in GENRES["house"].travel:
            continue
        seen.add(name)
        waiting = sum(count.move is GENRES["house"].rest for count in counts)
        moves = {count.move.name for count in counts if count.move is not GENRES["house"].rest}
        if name not in ("canon", "ripple", "call"):
            assert waiting == (2 if name == "solo" else 0)
        assert (name in ("mirror", "pairs")) == (len({count.flip for count in counts}) == 2)
        assert (name == "duets") == (len(moves) == 2)
        assert (name == "levels") == (len({count.low for count in counts}) == 2)
    assert seen >= {"unison", "mirror", "canon", "ripple", "call", "duets", "levels"}


def test_groups_change_formation_and_are_seldom_in_unison():
    """In half a minute three formations; two phrases of five not in unison."""
    apart = []
    for seed, name in enumerate(GENRES):
        for dancers in (2, 3, 4, 5):
            beats = grid(seed, (90, 118), 31)
            dance, truth = choreograph(beats, dancers=dancers, seed=seed, seconds=30, genre=name)
            assert len({kind for _, kind, _ in truth.formations}) >= 3
            stops = [frame for frame, _ in truth.relations[1:]] + [dance.num_frames]
            apart += [
                (stop - start, kind != "unison")
                for (start, kind), stop in zip(truth.relations, stops, strict=True)
            ]
    frames, other = np.array(apart).T
    assert (frames * other).sum() / frames.sum() > 0.4


def test_minutes_of_solo_are_quick_and_hold_the_bars():
    dance, truth = choreograph(np.arange(0.2, 181, 0.55), dancers=1, seed=7, seconds=180)
    joints = dance.joints()
    assert dance.num_frames == 5400 and len({s[2] for s in truth.sections}) == 3
    assert dance.root.diff(dim=1).norm(dim=-1).max() < 0.12
    assert dance.root[..., (0, 2)].abs().max() < 2.5  # on the stage
    found = motion_beats(joints[0])
    assert np.mean([np.abs(found - b).min() <= 2 for b in truth.beats]) > 0.85


def test_every_genre_has_a_vocabulary_of_its_own():
    moves = {name: {(m.feet, m.left, m.body) for m in g.moves} for name, g in GENRES.items()}
    assert len(GENRES) >= 8 and min(map(len, moves.values())) >= 8
    assert len(set.union(*moves.values())) == sum(map(len, moves.values()))
    for genre in GENRES.values():
        assert genre.tempo[0] < genre.tempo[1]
        for move in (*genre.moves, *genre.travel, genre.rest):
            for key in (*move.arms[0], *move.arms[1]):
                assert key[1] in ARM_POSES, (genre.name, move.name, key)
            assert move.channels[0].shape == (8, 14) and move.falls is not None
            assert move.energy in (1, 2, 3)
    grooves = {(g.groove, g.style) for g in GENRES.values()}
    assert len(grooves) == len(GENRES)


def test_forearms_and_legs_do_not_pass_through_each_other(genre):
    """Shins and forearms are some 8 cm thick; what crosses in a turn for a frame is let pass."""
    for limb, share in (((18, 22, 19, 23), 0.004), ((4, 7, 5, 8), 0.004)):
        near = [
            segment_gap(*(joints[:, :, j] for j in limb)).flatten() < 0.06 for *_, joints in genre
        ]
        assert torch.cat(near).float().mean() < share


def segment_gap(a, b, c, d, points=9):
    """Smallest distance between segments a-b and c-d, sampled; (..., 3) -> (...)."""
    u = torch.linspace(0, 1, points)[:, None]
    p, q = (x[..., None, :] * (1 - u) + y[..., None, :] * u for x, y in ((a, b), (c, d)))
    return torch.cdist(p, q).amin((-1, -2))


def test_hands_stay_out_of_the_body(genre):
    for _, _, joints in genre[::5]:
        hands = joints[:, :, (22, 23)]
        torso = segment_gap(hands, hands, joints[:, :, :1], joints[:, :, 9:10], 12)
        head = (hands - joints[:, :, 15:16]).norm(dim=-1)
        assert torso.min() > 0.12 and head.min() > 0.12


def test_elbows_and_knees_bend_the_right_way(genre):
    for dance, _, joints in genre[::5]:
        world = world_rotations(dance.pose)
        for hip, knee, ankle in ((1, 4, 7), (2, 5, 8)):
            front = world[:, :, ankle, :, 2] * torch.tensor([1.0, 0.0, 1.0])
            bend = joints[:, :, knee] - (joints[:, :, hip] + joints[:, :, ankle]) / 2
            stands = dance.contact[:, :, hip - 1].bool()
            assert ((bend * front).sum(-1)[stands] > 0).all()
