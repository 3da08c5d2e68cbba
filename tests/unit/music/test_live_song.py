"""A stream dances to sound that arrives meanwhile."""

import numpy as np
import pytest
import torch

from dancediff.generation.pipeline import pipeline_of
from dancediff.generation.stream import Stream
from dancediff.music.causal import AHEAD
from dancediff.music.features import MFCC
from dancediff.music.live_song import LiveSong
from dancediff.music.sound_sources import played
from dancediff.music.synth import synth_song
from tiny_lodge import tiny_lodge
from tiny_tcdiffpp import tiny_tcdiffpp

ASK = {"dancers": 2, "seconds": 12, "steps": 2, "seed": 4}


@pytest.fixture(scope="module")
def song():
    return synth_song(920_005, seconds=14)[0]


@pytest.fixture(scope="module")
def model():
    return tiny_tcdiffpp(("preconditioning", "energy_condition"))


def live(song, **options) -> LiveSong:
    return LiveSong(played(song, in_real_time=False), song.rate, seconds=12, **options)


def test_only_as_much_is_heard_as_is_needed(song, model):
    heard = live(song)
    stream = model.stream(heard, **ASK)
    window, stride = model.config.num_frames, model.config.num_frames - stream.request.overlap
    next(stream)
    assert heard.music.num_frames <= max(window - 3.5 * 30, 0) + 4
    rest = list(stream)
    assert 1 + len(rest) >= 12 * 30 // stride
    assert heard.music.now <= 12


def test_the_same_sound_gives_the_same_dance(song, model):
    first = model.stream(live(song), **ASK)
    dance = torch.cat([piece.root for piece in first], 1)
    again = Stream.replay(model, live(song), first.log)
    assert torch.equal(dance, torch.cat([piece.root for piece in again], 1))
    assert dance.shape[1] == 360


@pytest.mark.parametrize("asked", [{"start": [(-1, 0), (1, 0)]}, {"end": [(-1, 0), (1, 0)]}])
def test_frames_that_are_danced_anew_are_handed_out_once(song, model, asked):
    """The next segment dances some of the shared frames again, where places are asked for."""
    pieces = list(model.stream(live(song), **ASK, **asked))
    assert sum(piece.num_frames for piece in pieces) == 360


def test_sound_that_arrives_is_refused_by_dances_that_take_the_whole_song(song, model):
    """They danced to silence."""
    for call in (model.generate, pipeline_of(tiny_lodge()).generate):
        with pytest.raises(ValueError, match=r"LiveSong, not heard yet; use stream"):
            call(live(song), seconds=5)
    for pipeline, options in ((model, {"long_sampling": "naive"}), (pipeline_of(tiny_lodge()), {})):
        with pytest.raises(
            ValueError, match=r"song is a LiveSong, but this dance of .* whole song"
        ):
            pipeline.stream(live(song), **options)
    with pytest.raises(ValueError, match=r"opening=16.* leave it out for a LiveSong"):
        model.stream(live(song, keep=True), opening=16)


def test_frames_are_known_foretold_or_silent(song):
    heard = live(song, ahead=2.0)
    M = heard.features_until(180)
    now = heard.music.num_frames
    assert 4 <= heard.music.now < 4.15 and M.shape == (361, 35)
    torch.testing.assert_close(M[:now], heard.music.window(0, now))
    assert M[now : now + AHEAD * 30, MFCC.start].min() > -1100
    assert (M[now + AHEAD * 30 :, MFCC.start] < -1100).all()
    assert heard.features() is M  # nothing more was heard
    later = heard.features_until(240)
    assert later is not M and heard.music.now >= 6
    assert len(heard.beats()) > 5 and heard.tempo > 50


def test_the_end_of_the_sound_is_no_error():
    heard = LiveSong([np.zeros(2000)], 15360, seconds=8)
    assert torch.isfinite(heard.features_until(240)).all() and heard.music.now < 0.2


def test_ahead_and_length_have_limits():
    with pytest.raises(ValueError, match="ahead=6"):
        LiveSong([], 15360, ahead=6)
    with pytest.raises(ValueError, match="seconds=0 must be a number above 0"):
        LiveSong([], 15360, seconds=0)
