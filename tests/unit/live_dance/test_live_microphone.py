"""A live dance to sound that arrives: blocks come when they have sounded, by a made-up clock."""

from types import SimpleNamespace

import numpy as np
import pytest
import torch

from dancediff import hub
from dancediff.cli import main
from dancediff.generation.stream import Stream
from dancediff.live_dance import notebook
from dancediff.live_dance.page import live_page
from dancediff.live_dance.session import LiveSession
from dancediff.music.live_song import LiveSong
from dancediff.music.sound_sources import played
from dancediff.music.synth import synth_song
from tiny_tcdiffpp import tiny_tcdiffpp

SECONDS = 14
ASK = {"dancers": 2, "steps": 8, "seed": 3, "guidance": 1, "autoguidance": 1}


class Room:
    """A song is played; each guess takes ``cost`` seconds a dancer."""

    def __init__(self, song, cost: float, **options):
        self.now, self.cost, self.told, self.closed = 0.0, cost, [], False
        self.pipeline = tiny_tcdiffpp()
        self.pipeline.model.denoise = self.guess
        heard = LiveSong(
            self.blocks(song), song.rate, seconds=SECONDS, keep=True, clock=lambda: self.now
        )
        self.session = LiveSession(self.pipeline, heard, tell=self.tell, **ASK | options)

    def blocks(self, song):
        try:
            yield from played(song, clock=lambda: self.now, sleep=self.goes_on)
        finally:
            self.closed = True

    def goes_on(self, seconds: float) -> None:
        self.now += seconds

    def guess(self, x, t, conditions):
        self.now += self.cost * x.shape[0] * x.shape[1]
        return 0.9 * x

    def tell(self, kind, facts):
        self.told.append((kind, facts, self.now))
        if kind == "piece" and facts["start"] * 30 + facts["motion"].num_frames >= SECONDS * 30:
            self.session.stop()

    def dance(self):
        self.session._run()  # in this thread
        assert "failed" not in [kind for kind, *_ in self.told]
        return [(facts["start"], at) for kind, facts, at in self.told if kind == "piece"]


@pytest.fixture(scope="module")
def song():
    return synth_song(3, seconds=SECONDS + 1)[0]


def test_pieces_are_there_before_their_sound(song):
    room = Room(song, 0.05)  # 0.8 s for a segment
    pieces = room.dance()
    assert [start for start, _ in pieces] == [0.0, 5.0, 7.5, 10.0, 12.5]
    for start, at in pieces[1:]:
        assert start - 2.5 < at < start  # not before the segment may be known, and in time
    assert room.session.slow == "" and room.closed
    states = [facts for kind, facts, _ in room.told if kind == "state"]
    assert all(0 < facts["now"] <= room.now + 0.001 for facts in states)


def test_what_was_heard_is_saved_and_danced_again(song):
    room = Room(song, 0.05)
    room.dance()
    dance, sound = room.session.dance()
    assert dance.num_frames == SECONDS * 30 and dance.meta["seams"] == [150, 225, 300, 375]
    there = int(10 * song.rate)
    np.testing.assert_allclose(sound.audio[:there, 0], song.audio[:there].mean(axis=1), atol=1e-6)
    assert abs(sound.duration - SECONDS) < 0.01
    room.cost = 0.0
    heard = LiveSong(played(song, in_real_time=False), song.rate, seconds=SECONDS)
    again = Stream.replay(room.pipeline, heard, room.session.stream.log | {"opening": None})
    assert again.request.seconds == SECONDS
    assert torch.equal(torch.cat([piece.root for piece in again], 1), dance.root)


@pytest.mark.parametrize(
    ("options", "seams"),
    [
        ({"seam": "fade"}, [150, 225, 300, 375]),
        ({"start": [(-1, 0), (1, 0)]}, [120, 195, 270, 345]),
        ({"overlap": 50}, [150, 250, 350]),
    ],
)
def test_seams_are_where_segments_take_over_and_not_where_pieces_end(song, options, seams):
    room = Room(song, 0.0, **options)
    room.dance()
    assert room.session.dance()[0].meta["seams"] == seams


def test_frames_are_handed_out_early_and_are_the_same(song):
    """A segment is handed out whole; without haste its end is kept for the next one."""
    heard = [LiveSong(played(song, in_real_time=False), song.rate, seconds=12) for _ in range(2)]
    model = tiny_tcdiffpp()
    early, late = (model.stream(one, **ASK | {"steps": 2, "seconds": 12}) for one in heard)
    pieces = list(early)
    assert [piece.num_frames for piece in pieces] == [150, 75, 75, 60]
    with model._ready(late.request, False) as how:
        parts = [x for _, x in late._dance.pieces(lambda: None, **how)]
    assert [x.shape[1] for x in parts] == [75, 75, 75, 75, 60]
    torch.testing.assert_close(
        torch.cat([piece.root for piece in pieces], 1), torch.cat(parts, 1)[..., 4:7]
    )


def test_who_is_late_takes_fewer_steps(song):
    room = Room(song, 0.1)  # 1.6 s for a segment, of which there is 1 s
    pieces = room.dance()
    assert room.session.stream.request.steps == 4 and room.session.stream.request.dancers == 2
    assert "too slow for 8 steps" in room.session.slow
    assert all(at < start for start, at in pieces[-2:])


def test_it_cannot_be_sought_in_and_has_no_song_on_its_page(song):
    session = Room(song, 0.1).session
    with pytest.raises(ValueError, match="microphone hears"):
        session.seek(3.0)
    page = live_page(session, "127.0.0.1:1")
    assert '"song":null' in page and '"listens":true' in page


@pytest.mark.parametrize("how", ["notebook", "command"])
def test_a_microphone_is_danced_to_for_as_long_as_is_asked(monkeypatch, tmp_path, how):
    """It ended after 600 s, and more could not be asked for."""
    served = []

    class Server:
        def __init__(self, pipeline, song, *, save, port=0, **options):
            self.address = "nowhere"
            served.append(LiveSession(pipeline, song, **options).stream.request.seconds)

        def start(self):
            return self

        wait = stop = start

    monkeypatch.setattr(notebook, "listen", lambda rate, *, device: iter([]))
    monkeypatch.setattr(notebook, "LiveServer", Server)
    monkeypatch.setattr("dancediff.live_dance.server.LiveServer", Server)
    if how == "notebook":
        notebook.live(model=tiny_tcdiffpp(), microphone=True, seconds=700)
    else:
        hub.save_model(tiny_tcdiffpp().model, tmp_path / "tiny")
        asked = ["--microphone", "--seconds", "700", "--model", str(tmp_path / "tiny")]
        assert main(["live", *asked, "--no-browser"]) == 0
    assert served == [700.0]


def test_a_song_or_a_microphone(monkeypatch, song):
    asked = SimpleNamespace()

    def listen(rate, *, device):
        asked.rate, asked.device = rate, device
        return iter([np.zeros((4410, 1), np.float32)])

    monkeypatch.setattr(notebook, "listen", listen)
    heard = notebook.source_of(None, 3)
    assert isinstance(heard, LiveSong) and (asked.rate, asked.device) == (22050, 3)
    assert notebook.source_of(None, True).name == "microphone" and asked.device is None
    assert notebook.source_of(song) is song
    assert [notebook.source_of(None, True, s).duration for s in (None, 7200.0)] == [600.0, 7200.0]
    for both in ((song, True), (None, False)):
        with pytest.raises(ValueError, match="give one of them"):
            notebook.source_of(*both)
