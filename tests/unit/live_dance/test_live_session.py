"""A live session: it stays ahead, slows down where it must, and is saved as what was danced."""

import json
import time

import pytest
import torch

from dancediff.extensions.control import WalkAlong
from dancediff.generation.stream import Stream
from dancediff.live_dance.session import LiveSession
from dancediff.motion.motion import Motion
from dancediff.music.synth import synth_song
from tiny_tcdiffpp import tiny_tcdiffpp

ASK = {"dancers": 2, "steps": 8, "seed": 3}


@pytest.fixture(scope="module")
def model():
    return tiny_tcdiffpp()


@pytest.fixture(scope="module")
def song():
    return synth_song(2, seconds=40.0)[0]


def until(true, seconds=60.0):
    end = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.fixture
def open_session(model, song):
    """Starts sessions that end with the test; what they told is beside them."""
    sessions = []

    def start(**options):
        told = []
        session = LiveSession(model, song, tell=lambda *news: told.append(news), **ASK | options)
        sessions.append(session.start())
        return session, told

    yield start
    for session in sessions:
        session.stop()
        session.join(60)
        assert not session.is_running


def test_it_stays_ahead_and_rests(open_session):
    session, told = open_session()
    until(lambda: session.ahead > 5)
    time.sleep(0.5)
    ready = session.ahead
    assert 5 < ready <= 7.5
    session.played(5.0)
    until(lambda: session.ahead > 5)
    assert session.have[: ((5 + 5) * 30)].all()
    kinds = [kind for kind, _ in told]
    assert kinds.count("piece") == len(session._pieces) and "failed" not in kinds
    until(lambda: "beats" in [kind for kind, _ in told] or session.played(20.0))


def test_it_dances_with_constraints_that_no_log_can_hold(open_session, tmp_path):
    session, told = open_session(constraints=WalkAlong(0, [(0, -1, 0)]), dtype="bfloat16")
    until(lambda: told and told[-1][0] == "state")
    assert "failed" not in [kind for kind, _ in told]
    session.stop()
    session.join(60)
    (tmp_path / "log.json").write_text("of an earlier dance")
    (file,) = session.save(tmp_path, ["npz"])
    assert file.name == "dance.npz" and [*tmp_path.iterdir()] == [file]


def test_a_knob_is_seen_with_the_next_piece(open_session):
    session, told = open_session()
    until(lambda: session.ahead > 5)
    there = len(session._pieces)
    session.set(swap=(1, 0))  # it does not wait until less is ready
    until(lambda: any(kind == "knob" for kind, _ in told))
    knob = next(facts for kind, facts in told if kind == "knob")
    assert knob["set"] == {"swap": (1, 0)} and knob["piece"] == there
    assert knob["from"] == 2.5 * there


def test_what_was_danced_is_saved_and_danced_again(open_session, model, song, tmp_path):
    session, _ = open_session()
    until(lambda: session.ahead > 5)
    session.seek(20.0)
    until(lambda: session.have[700])
    session.stop()
    session.join(60)
    files = session.save(tmp_path / "saved", ["npz", "html", "bvh"])
    assert [file.suffix for file in files][:2] == [".npz", ".html"]
    dance, sound = session.dance()
    torch.testing.assert_close(Motion.load(files[0]).pose, dance.pose)
    assert abs(sound.duration - dance.duration) < 0.01
    log = json.loads((tmp_path / "saved" / "log.json").read_text())
    again = torch.cat([piece.pose for piece in Stream.replay(model, song, log)], 1)
    assert torch.equal(again, dance.pose)


def test_what_lies_behind_a_jump_is_danced_anew(open_session):
    """What was danced there before goes on from other places: somebody would jump."""
    session, told = open_session()
    until(lambda: session.ahead > 5)
    session.played(8.0)
    until(lambda: session.ahead > 5)
    session.seek(3.0)
    until(lambda: session.ahead > 5)
    starts = [facts["start"] for kind, facts in told if kind == "piece"]
    anew = starts[starts.index(3.0) :]
    assert len(anew) >= 2 and anew == sorted(anew)


def test_what_goes_wrong_is_told(open_session, monkeypatch):
    def fail(self, frame):
        raise RuntimeError("no memory")

    monkeypatch.setattr("dancediff.generation.opening.Opening.features_until", fail)
    session, told = open_session()
    until(lambda: told)
    assert told[0] == ("failed", {"text": "no memory"})
    with pytest.raises(ValueError, match="nothing was danced yet"):
        session.dance()
