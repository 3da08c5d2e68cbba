"""A stream that is steered: changes hold from the next segment on, and can be made again."""

import itertools
import json
import threading
from dataclasses import dataclass

import numpy as np
import pytest
import torch

from dancediff.extensions.control import WalkAlong
from dancediff.generation.opening import Opening
from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.stream import Stream
from dancediff.motion.motion import Motion
from dancediff.music.synth import synth_song
from dancediff.papers.fact.model import FACT, FACTConfig
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp


@dataclass
class Tune:
    """As much of a song as a stream looks at."""

    duration: float = 12.0
    name: str = "tune"
    tempo: float = 120.0
    is_silent: bool = False
    peak: float = 0.5

    def features(self):
        generator = torch.Generator().manual_seed(int(self.duration))
        return torch.randn(1 + int(30 * self.duration), 35, generator=generator)


ASK = {"dancers": 3, "seconds": 12, "steps": 2, "seed": 4}


@pytest.fixture(scope="module")
def model():
    return tiny_tcdiffpp()


@pytest.fixture(scope="module")
def listening():
    """A model that knows genres and listens to energy."""
    return tiny_tcdiffpp(("preconditioning", "genre_condition", "energy_condition"))


def whole(pieces):
    return torch.cat([piece.root for piece in pieces], 1)


def steered(stream, calls):
    """All pieces; ``calls[k]`` is done once k pieces are there."""
    pieces = []
    calls.get(0, lambda _: None)(stream)
    for piece in stream:
        pieces.append(piece)
        calls.get(len(pieces), lambda _: None)(stream)
    return pieces


@pytest.mark.parametrize(
    "change", [{"genre": "salsa"}, {"energy": 0.2}, {"swap": (2, 1, 0)}, {"steps": 1},
               {"formation": [(-2, 1), (0, -1), (2, 1)]}]
)  # fmt: skip
def test_a_change_holds_from_the_next_segment_on(listening, change):
    song = Tune()
    plain = list(listening.stream(song, **ASK))
    other = steered(listening.stream(song, **ASK), {2: lambda stream: stream.set(**change)})
    assert [p.num_frames for p in plain] == [p.num_frames for p in other] == [75, 75, 75, 75, 60]
    # the third piece was danced with the second segment, but for its end
    assert torch.equal(whole(plain[:2]), whole(other[:2]))
    assert not torch.equal(whole(plain[3:]), whole(other[3:]))


@pytest.mark.parametrize("given", [{}, {"genre_guidance": 3.0}])
def test_a_genre_of_a_stream_is_guided_as_that_of_a_dance(listening, given):
    stream = listening.stream(Tune(), **ASK, **given)
    list(steered(stream, {1: lambda s: s.set(genre="salsa")}))
    asked = listening.resolve(Tune(), **ASK, **given, genre="salsa").genre_guidance
    assert stream.request.genre_guidance == asked > 1


def test_who_leaves_is_the_last_and_nobody_else_jumps(model):
    stream = model.stream(Tune(), swap=(2, 0, 1), swap_at=10, **ASK)
    pieces = steered(stream, {2: lambda s: s.set(dancers=2), 3: lambda s: s.set(swap=(1, 0))})
    assert [piece.num_dancers for piece in pieces] == [3, 3, 2, 2, 2]
    assert stream.log["calls"] == [
        {"piece": 2, "set": {"dancers": 2}},
        {"piece": 3, "set": {"swap": [1, 0]}},
    ]
    untouched = list(model.stream(Tune(), swap=(2, 0, 1), swap_at=10, **ASK))
    assert torch.equal(whole(pieces[:2]), whole(untouched[:2]))
    last, next_one = pieces[1].root[:2, -1], pieces[2].root[:, 0]
    steps = torch.cat([piece.root[:2] for piece in pieces[:2]], dim=1).diff(dim=1).norm(dim=-1)
    assert (next_one - last).norm(dim=-1).max() < 4 * steps.median(1).values.max()
    apart = (last[0] - last[1]).norm()  # who changed rows would jump that far
    assert (next_one - last).norm(dim=-1).max() < apart
    again = list(Stream.replay(model, Tune(), json.loads(json.dumps(stream.log))))
    assert all(torch.equal(a.pose, b.pose) for a, b in zip(pieces, again, strict=True))


def test_what_is_asked_for_is_open_until_a_segment_is_danced_with_it(model):
    stream = model.stream(Tune(), **ASK)
    assert not stream.is_asked and stream.has_features
    stream.set(steps=1)
    assert stream.is_asked
    next(stream)
    assert not stream.is_asked


def test_what_is_asked_for_behind_a_leave_is_checked_for_those_who_stay(model):
    stream = model.stream(Tune(), **ASK)
    stream.set(swap=(2, 1, 0))  # taken up before one of them leaves
    stream.set(dancers=2)
    with pytest.raises(ValueError, match="swap"):
        stream.set(swap=(2, 1, 0))
    with pytest.raises(ValueError, match="cannot join"):
        stream.set(dancers=3)
    with pytest.raises(ValueError, match="alone"):
        stream.set(dancers=1, swap=(0,))
    with pytest.raises(ValueError):
        stream.set(formation=[(-1, 0), (0, 0), (1, 0)])
    assert next(stream).num_dancers == 2 and stream.can_leave
    stream.set(dancers=1)
    assert not stream.can_leave
    with pytest.raises(ValueError, match="no start="):
        model.stream(Tune(), start=[(-1, 0), (0, 0), (1, 0)], **ASK).set(dancers=1)


def test_dancers_stand_where_they_were_asked_to(model):
    places = [(-1.5, 0.5), (0.2, -0.5), (1.5, 0.5)]
    stream = model.stream(Tune(), **ASK | {"steps": 8, "foot_contact": False})
    pieces = steered(stream, {1: lambda stream: stream.set(formation=places)})
    at = whole(pieces)[:, 75 + 149, [0, 2]]
    torch.testing.assert_close(at, torch.tensor(places), atol=0.05, rtol=0)


def test_it_goes_on_elsewhere_in_the_song(model):
    """That nobody jumps is tested with trained weights; with these all do, in every frame."""
    begins, pieces = [], []
    stream = model.stream(Tune(), **ASK)
    for piece in stream:
        pieces.append(piece)
        begins.append(stream.begins)
        if len(pieces) == 1:
            stream.seek(8.0)
        if stream.is_over:
            stream.seek(2.0)  # it wakes up again
        if len(pieces) == 6:
            break
    assert begins[:2] == [0, 8] and 2.0 in begins
    assert pieces[1].num_frames == 60 and begins[2] == 10


def test_elsewhere_in_the_song_the_dance_goes_on_from_where_everybody_was(model):
    def behind(steps):
        """The piece behind a jump; only the one before it had so many steps."""
        stream = model.stream(Tune(), **ASK | {"steps": steps})
        return steered(stream, {1: lambda s: (s.seek(8.0), s.set(steps=2))})[1]

    assert not torch.equal(behind(1).root, behind(2).root)


@pytest.mark.parametrize(
    "options",
    [{}, {"overlap": 50}, {"start": [(-1, 0), (0, 0), (1, 0)]}, {"long_sampling": "naive"}],
)
def test_a_piece_has_the_seams_of_its_own_frames(model, options):
    options = ASK | {"swap": (2, 1, 0)} | options
    dance, pieces = model.generate(Tune(), **options), list(model.stream(Tune(), **options))
    ends = np.cumsum([piece.num_frames for piece in pieces]).tolist()
    parts = [dance.frames(a, b) for a, b in itertools.pairwise([0, *ends])]
    assert [p.meta["seams"] for p in pieces] == [p.meta["seams"] for p in parts]
    assert ["swap" in p.meta for p in pieces] == ["swap" in p.meta for p in parts]
    last = pieces[-1].meta
    assert last.get("whole", last) == dance.meta


def test_a_seam_lies_where_the_dance_goes_on_elsewhere(model):
    stream = model.stream(Tune(20.0), **ASK | {"seconds": 20, "overlap": 100})
    pieces = steered(stream, {3: lambda stream: stream.seek(10.0)})
    # without the jump one at 200 would have followed; 35 frames are new in the segment behind it
    assert [piece.num_frames for piece in pieces][:6] == [50, 50, 50, 35, 50, 50]
    assert pieces[-1].meta["whole"]["seams"] == [150, 285, 335, 385, 435]


def test_the_last_half_frame_is_the_last_frame(model):
    """Rounded, 11.99 s is the frame behind the last one: such a dance never ended."""
    pieces = steered(model.stream(Tune(), **ASK), {1: lambda stream: stream.seek(11.99)})
    assert [piece.num_frames for piece in pieces] == [75, 1]


@pytest.mark.parametrize("pinning", ["same_noise", "init"])
def test_a_log_makes_the_same_dance_again(listening, pinning):
    song = Tune(20.0)
    stream = listening.stream(song, **ASK | {"pinning": pinning})
    pieces = steered(
        stream,
        {
            0: lambda stream: stream.set(genre={"salsa": 1, "jazz": 3}),
            1: lambda stream: stream.set(swap=(1, 2, 0), energy=((0.0, 0.1), (9.0, 0.9))),
            2: lambda stream: stream.seek(7.3),
            3: lambda stream: stream.set(steps=1),
            5: lambda stream: stream.stop(),
        },
    )
    assert len(pieces) == 5
    log = json.loads(json.dumps(stream.log))
    again = Stream.replay(listening, song, log)
    made = list(again)
    assert len(made) == 5 and torch.equal(whole(pieces), whole(made))
    assert all(torch.equal(a.pose, b.pose) for a, b in zip(pieces, made, strict=True))
    assert json.loads(json.dumps(again.log)) == log


def test_a_log_holds_names_instead_of_objects_of_torch(model):
    ask = ASK | {"seconds": 2, "dtype": torch.bfloat16, "device": torch.device("cpu")}
    stream = model.stream(Tune(), **ask)
    made, log = list(stream), json.loads(json.dumps(stream.log))
    assert log["options"] == ASK | {"seconds": 2, "dtype": "bfloat16", "device": "cpu"}
    assert torch.equal(whole(made), whole(list(Stream.replay(model, Tune(), log))))


def test_a_log_of_what_is_no_plain_value_is_refused(model):
    stream = model.stream(Tune(), constraints=WalkAlong(0, [(0, 0, 0)]), **ASK)
    with pytest.raises(ValueError, match="leave constraints= out"):
        _ = stream.log
    assert stream.calls == []
    still = Motion(torch.eye(3).expand(1, 60, 24, 3, 3), torch.zeros(1, 60, 3))
    fact = pipeline_of(FACT(FACTConfig(d_model=8, num_heads=2, ff_dim=8, max_dancers=1)))
    with pytest.raises(ValueError, match="leave seed_motion= out"):
        _ = fact.stream(Tune(), dancers=1, seed_motion=still).log


@pytest.mark.parametrize(
    "knobs, words",
    [
        ({"tempo": 3}, "tempo= cannot be set while dancing"),
        ({"swap": (0, 1)}, "swap"),
        ({"genre": "salsa"}, "needs a model that knows genres"),
        ({"formation": [(0, 0)]}, "1 places for 3 dancers"),
        ({"formation": [(0, 0)] * 3, "swap": (0, 1, 2)}, "not both"),
        ({"steps": 0}, "steps=0"),
        ({"dancers": "2"}, "dancers='2' must be an integer"),
        ({"dancers": 4}, r"dancers=4 must lie in 1 \.\.\. 3"),
    ],
)
def test_it_refuses_what_it_cannot_do_at_once(model, knobs, words):
    stream = model.stream(Tune(), **ASK)
    with pytest.raises(ValueError, match=words):
        stream.set(**knobs)
    assert stream.log["calls"] == []


def test_seek_and_formation_need_a_dance_without_constraints(model):
    stream = model.stream(Tune(), start=[(-1, 0), (0, 0), (1, 0)], **ASK)
    for call in (lambda: stream.seek(3), lambda: stream.set(formation=[(0, 0)] * 3)):
        with pytest.raises(ValueError, match="leave them out"):
            call()
    with pytest.raises(ValueError, match="must lie in 0"):
        model.stream(Tune(), **ASK).seek(12.5)


def test_a_dance_made_in_advance_cannot_be_steered():
    stream = pipeline_of(tiny_lodge()).stream(Tune(), seconds=3, steps=1)
    with pytest.raises(ValueError, match="cannot be steered"):
        stream.set(genre="salsa")
    assert sum(piece.num_frames for piece in stream) == 90


def test_stop_leaves_a_segment_that_another_thread_makes(model):
    begun, stopped, reported = threading.Event(), threading.Event(), []

    def progress(done, total):
        begun.set()
        assert stopped.wait(60)
        reported.append(done)

    stream = model.stream(Tune(60.0), progress=progress, dancers=3, steps=50)
    pieces: list = []
    thread = threading.Thread(target=lambda: pieces.extend(stream))
    thread.start()
    assert begun.wait(60)
    stream.stop()
    stopped.set()
    thread.join(60)
    assert not thread.is_alive() and not pieces
    assert reported == [1]
    assert not model.model.training


@pytest.mark.parametrize("call", [Stream.stop, next])
def test_another_thread_may_end_a_stream_between_any_two_lines(model, call):
    """What a stream is making may be gone at the second look."""
    stream = model.stream(Tune(), dancers=1, seconds=5, steps=1)
    looks = [stream._make()]
    seen = property(lambda _: looks.pop() if looks else None, lambda *_: None)
    stream.__class__ = type("Ending", (Stream,), {"_made": seen})
    call(stream)
    assert not looks


def test_an_opening_is_enough_to_begin_with(model):
    song, _ = synth_song(2, seconds=40.0)
    stream = model.stream(song, opening=16.0, dancers=1, steps=1)
    first = next(stream)
    assert first.num_frames == 75 and stream.timing.pieces == 1 and stream.timing.first > 0
    pieces = [first, *stream]
    assert sum(piece.num_frames for piece in pieces) == 1200
    again = Stream.replay(model, song, json.loads(json.dumps(stream.log)))
    assert torch.equal(whole(pieces), whole(list(again)))


def test_an_opening_is_refused_where_it_would_not_help(model):
    song, _ = synth_song(2, seconds=40.0)
    lodge = pipeline_of(tiny_lodge())
    with pytest.raises(
        ValueError, match=r"opening=16.0, but this dance of 'lodge' needs the whole"
    ):
        lodge.stream(song, opening=16.0)
    with pytest.raises(ValueError, match="opening='20' must be at least 15 s"):
        model.stream(song, opening="20")
    with pytest.raises(ValueError, match="song is None"):
        model.stream(None, opening=20)


def test_a_stream_of_a_file_is_danced_again_from_that_file(model, tmp_path):
    path = tmp_path / "song.wav"
    synth_song(2, seconds=20.0)[0].save(path)
    stream = model.stream(path, dancers=1, seconds=5, steps=1)
    again = Stream.replay(model, path, stream.log)
    assert torch.equal(whole(stream), whole(again))


def test_a_log_is_plain_whatever_was_given(model):
    row = np.array([[-1.0, 0], [0, 0], [1, 0]])
    stream = model.stream(Tune(), **ASK | {"steps": np.int64(2), "start": row})
    first = [next(stream), next(stream)]
    log = json.loads(json.dumps(stream.log))
    again = Stream.replay(model, Tune(), log)
    assert torch.equal(whole(first), whole([next(again), next(again)]))


def test_wrong_kinds_are_named(model):
    stream = model.stream(Tune(), **ASK)
    with pytest.raises(ValueError, match=r"swap=1 must hold each of 0\.\.2"):
        stream.set(swap=1)
    with pytest.raises(ValueError, match=r"seek\('3'\) must lie in 0 ... 12 s"):
        stream.seek("3")


def test_an_opening_has_features_of_its_own():
    song, _ = synth_song(2, seconds=40.0)
    opening = Opening(song, 20.0)
    assert len(opening.features_until(450)) == 601
    assert len(opening.features_until(460)) == len(opening.features()) == 1201
    assert len(Opening(song, 60.0).features_until(5)) == 1201
    with pytest.raises(ValueError, match="at least 15 s"):
        Opening(song, 3.0)


def test_ahead_is_what_is_ready_minus_what_was_played(model):
    stream = model.stream(Tune(), **ASK)
    next(stream)
    assert stream.ahead(played=1.0) == 1.5 and stream.ahead() < 2.5
    next(stream)
    assert stream.ahead(played=1.0) == 4.0 and stream.timing.pieces == 2
    assert stream.timing.longest >= stream.timing.last > 0
