"""On a slow computer a live dance takes fewer steps, then fewer dancers, and does not stutter.

The clock is made up: it goes on when the network computes, and when the session rests.
"""

from types import SimpleNamespace

import pytest
import torch

from dancediff.axes import FPS
from dancediff.generation.stream import Stream
from dancediff.live_dance.session import EASY, FEWEST, LiveSession
from dancediff.music.synth import synth_song
from tiny_tcdiffpp import tiny_tcdiffpp

SECONDS = 24.0
ASK = {"dancers": 3, "steps": 12, "seed": 3, "guidance": 1, "autoguidance": 1}
TICK = 0.01


class SlowComputer:
    """Each guess takes ``cost`` seconds a dancer, while a player plays on."""

    def __init__(self, monkeypatch, song, cost: float, **ask):
        self.now, self.cost, self.stalls, self.waits, self.told = 0.0, cost, [], True, []
        pipeline = tiny_tcdiffpp()
        pipeline.model.denoise = self.computes
        clock = SimpleNamespace(perf_counter=lambda: self.now)
        monkeypatch.setattr("dancediff.generation.stream.time", clock)
        monkeypatch.setattr(LiveSession, "_rest", lambda session: self.goes_on(0.1))
        self.session = LiveSession(
            pipeline, song, tell=lambda *news: self.told.append(news), **ASK | ask
        )

    def computes(self, x, t, conditions):
        self.goes_on(self.cost * x.shape[0] * x.shape[1])
        return 0.9 * x

    def goes_on(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK)):
            self.now += TICK
            self.plays()

    def plays(self) -> None:
        """As a page: it waits where the next frame is missing, until a second is ready."""
        session = self.session
        if session.at >= SECONDS - 0.1:
            session.stop()
        elif self.waits and session.ahead >= min(1.0, SECONDS - session.at):
            self.waits = False
        elif not self.waits and session.ahead < 2 / FPS:
            self.waits = True
            self.stalls.append(session.at)
        if not self.waits:
            session.played(session.at + TICK)

    def dance(self) -> LiveSession:
        self.session.start().join(300)
        assert not self.session.is_running
        assert "failed" not in [kind for kind, _ in self.told]
        return self.session

    def said(self) -> list[str]:
        """Each thing once, in order."""
        return list(dict.fromkeys(f["slow"] for kind, f in self.told if kind == "state"))


@pytest.fixture(scope="module")
def song():
    return synth_song(2, seconds=SECONDS)[0]


@pytest.mark.parametrize("cost", [0.05, 0.02])  # 1.8 s for a piece of 2.5 s, or 0.7 s
def test_a_fast_computer_keeps_all(monkeypatch, song, cost):
    computer = SlowComputer(monkeypatch, song, cost)
    session = computer.dance()
    assert computer.said() == [""] and computer.stalls == []
    assert session.stream.request.steps == 12 and session.stream.log["calls"][:-1] == []


def test_steps_are_lowered_first(monkeypatch, song):
    computer = SlowComputer(monkeypatch, song, 0.1)  # 3.6 s for a piece of 2.5 s
    session = computer.dance()
    said = ["", "This computer is too slow for 12 steps; now it is 6."]
    assert computer.said() == said
    assert session.stream.request.steps == 6 and session.stream.request.dancers == 3
    assert all(at < 6 for at in computer.stalls)  # once, before it is known


def test_steps_come_back_when_there_is_time_again(monkeypatch, song):
    computer = SlowComputer(monkeypatch, song, 0.1)  # 3.6 s for a piece of 2.5 s
    stream = computer.session.stream

    def other_work_ends(x, t, conditions):
        computer.cost = 0.05 if stream.begins >= 5 else 0.1  # 1.8 s for 12 steps, 0.9 for 6
        return computer.computes(x, t, conditions)

    computer.session.pipeline.model.denoise = other_work_ends
    session = computer.dance()
    assert computer.said() == ["", "This computer is too slow for 12 steps; now it is 6."]
    assert computer.told[-1][1]["slow"] == ""
    fewer, more = (call for call in stream.log["calls"] if "set" in call)
    assert (fewer["set"], more["set"]) == ({"steps": 6}, {"steps": 12})
    assert session.stream.request.steps == 12
    assert more["piece"] - fewer["piece"] > EASY  # a single fast piece is no proof
    assert all(at < 6 for at in computer.stalls)


def test_then_dancers_stand_still(monkeypatch, song):
    computer = SlowComputer(monkeypatch, song, 0.24)  # 2.9 s for 3 dancers with 4 steps
    session = computer.dance()
    assert computer.said() == [
        "",
        "This computer is too slow for 12 steps; now it is 6.",
        f"This computer is too slow for 6 steps; now it is {FEWEST}.",
        "This computer is too slow for 3 dancers with 4 steps: dancer 2 stands still from now on.",
    ]
    calls = [call["set"] for call in session.stream.log["calls"] if "set" in call]
    assert calls == [{"steps": 6}, {"steps": 4}, {"dancers": 2}]
    assert all(at < 11 for at in computer.stalls)
    dance, _ = session.dance()
    left = round(session.stream.log["calls"][2]["piece"] * 2.5 * FPS)
    assert dance.num_dancers == 3 and 0 < left < dance.num_frames
    steps = dance.root[:, left - 1 :].diff(dim=1).abs().amax(dim=(1, 2))
    assert steps[2] == 0 and (steps[:2] > 0).all()
    again = list(Stream.replay(session.pipeline, song, session.stream.log))
    assert [piece.num_dancers for piece in again].count(2) > 3
    assert torch.equal(torch.cat([piece.root[:2] for piece in again], 1), dance.root[:2])


def test_who_cannot_do_with_less_says_that_the_dance_waits(monkeypatch, song):
    computer = SlowComputer(monkeypatch, song, 1.0, dancers=2)
    session = computer.dance()
    assert computer.said()[-1] == (
        "This computer is too slow for 1 dancer with 4 steps: the dance waits for it."
    )
    assert session.stream.request.dancers == 1 and computer.stalls
