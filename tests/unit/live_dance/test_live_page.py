"""The page, its sound and what a notebook shows; what they do together is tested in a browser."""

import io
import json
import re
import time

import numpy as np
import pytest
import soundfile

from dancediff.live_dance.notebook import live
from dancediff.live_dance.page import knobs, live_page
from dancediff.live_dance.server import LiveServer
from dancediff.live_dance.session import LiveSession
from dancediff.live_dance.sound import MOST, WavFile, asked_range
from dancediff.music.song import Music
from dancediff.music.synth import synth_song
from dancediff.threads import Worker
from tiny_tcdiffpp import tiny_tcdiffpp


@pytest.fixture(scope="module")
def song():
    song = synth_song(2, seconds=20.0)[0]
    return Music(song.audio, song.rate, name="</script><b>hum")


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_the_parts_of_the_sound_are_a_file(channels):
    noise = np.random.default_rng(0).uniform(-1.2, 1.2, (30_001, channels)).astype(np.float32)
    wav = WavFile(Music(noise, 8000))
    parts = [wav.part(k, k + 777) for k in range(0, wav.size, 777)]
    assert b"".join(parts) == wav.part(0, wav.size)
    sound, rate = soundfile.read(io.BytesIO(b"".join(parts)), always_2d=True)
    assert rate == 8000 and sound.shape == (30_001, min(channels, 2))
    np.testing.assert_allclose(sound, noise[:, :2].clip(-1, 1), atol=1e-4)


def test_an_answer_is_never_large():
    wav = WavFile(Music(np.zeros((MOST, 2), np.float32), 44100))
    assert len(wav.part(0, wav.size)) == MOST and len(wav.part(44, wav.size)) == MOST


@pytest.mark.parametrize("header", ["bytes=100-", "bytes=9-3", "lines=1-2", "bytes=x-", "bytes="])
def test_a_range_outside_is_refused(header):
    with pytest.raises(ValueError):
        asked_range(header, 100)


def test_the_page_may_speak_to_its_server_alone(song):
    page = live_page(LiveSession(tiny_tcdiffpp(), song, dancers=2), "127.0.0.1:8765")
    policy = re.search(r'Content-Security-Policy" content="(.*?)"', page)[1]
    assert "default-src 'none'" in policy and "connect-src 'self' ws://127.0.0.1:8765" in policy
    assert "<b>hum" not in page  # a name cannot become code
    data = json.loads(re.search(r'id="data">(.*?)</script>', page, re.DOTALL)[1])
    assert data["frames"] == 600 and data["song"] == "song.wav" and len(data["panes"]) == 1


def test_knobs_are_what_the_model_can_do(song):
    plain = knobs(LiveSession(tiny_tcdiffpp(), song, dancers=2))
    assert set(plain) == {"swap", "formation"}
    assert plain["swap"] == [("any", None), ("0 1", (0, 1)), ("1 0", (1, 0))]
    all_parts = tiny_tcdiffpp(("preconditioning", "genre_condition", "energy_condition"))
    assert set(knobs(LiveSession(all_parts, song, dancers=2))) == set(plain) | {"genre", "energy"}
    bare = tiny_tcdiffpp(())
    assert set(knobs(LiveSession(bare, song, dancers=1))) == set()


def test_a_notebook_shows_the_page(song):
    pytest.importorskip("tornado")
    shown = live(song, tiny_tcdiffpp(), dancers=2, steps=1)
    try:
        assert shown.server.address in shown._repr_html_() and "autoplay" in shown._repr_html_()
        assert shown.server.allows(shown.server.host, None)
        assert shown.server.allows(shown.server.host, f"http://localhost:{shown.server.port}")
        assert not shown.server.allows("example.org", None)
        assert not shown.server.allows(shown.server.host, "http://example.org")
    finally:
        shown.stop()
        shown.server.wait()
    assert not shown.server.is_running
    with pytest.raises(ValueError, match="dancers=9"):
        live(song, tiny_tcdiffpp(), dancers=9)


def test_two_clicks_on_save_do_not_write_at_once(song):
    pytest.importorskip("tornado")
    busy, most, told = [], [], []

    def save(session):
        busy.append(session)
        most.append(len(busy))
        time.sleep(0.2)
        busy.pop()
        return ["dance.npz"]

    server = LiveServer(tiny_tcdiffpp(), song, dancers=2, save=save)
    server._tell = lambda kind, facts: told.append((kind, facts))
    threads = [Worker(server._save).begin() for _ in range(3)]
    for thread in threads:
        thread.join(20)
    assert most == [1, 1, 1] and told == [("saved", {"files": ["dance.npz"]})] * 3


def test_what_was_danced_is_saved_after_the_page_was_closed(song, tmp_path):
    pytest.importorskip("tornado")
    shown = live(song, tiny_tcdiffpp(), dancers=2, steps=1)
    end = time.monotonic() + 60
    while not shown.session._pieces:
        assert time.monotonic() < end
        time.sleep(0.05)
    shown.server._call(shown.server.closed)
    shown.server.wait()
    assert [file.name for file in shown.save(tmp_path, ["npz"])] == ["dance.npz", "log.json"]
