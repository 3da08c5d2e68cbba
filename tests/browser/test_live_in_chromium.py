"""The page of a live dance: pieces arrive, knobs are obeyed, nobody else is let in, it ends.

With DANCEDIFF_LIVE_SECONDS=300 dance and sound are followed for five minutes.
"""

import asyncio
import os
import time
from concurrent.futures import ThreadPoolExecutor
from urllib.error import HTTPError
from urllib.request import Request, urlopen

import pytest
from chromium_page import SLOW, changed, num_colors, picture, until

from dancediff.live_dance import session
from dancediff.live_dance.server import LiveServer
from dancediff.music.live_song import LiveSong
from dancediff.music.sound_sources import played
from dancediff.music.synth import synth_song
from tiny_tcdiffpp import tiny_tcdiffpp

pytest.importorskip("tornado")

LIVE = "window.dancediff.live"
FOLLOWED = float(os.environ.get("DANCEDIFF_LIVE_SECONDS", "12"))
pytestmark = [pytest.mark.slow, pytest.mark.timeout(round(400 + 2 * FOLLOWED))]


@pytest.fixture(scope="module")
def model():
    return tiny_tcdiffpp(("preconditioning", "energy_condition"))


@pytest.fixture(scope="module")
def song():
    return synth_song(2, seconds=max(60.0, FOLLOWED + 10))[0]


@pytest.fixture
def nobody_leaves(monkeypatch):
    """However slow this computer is, a session asks for no less; that has tests of its own."""
    monkeypatch.setattr(session, "BUSY", float("inf"))


@pytest.fixture
def server(model, song, tmp_path, nobody_leaves):
    def save(session):
        return session.save(tmp_path, ["npz"])

    server = LiveServer(model, song, dancers=2, steps=2, seed=1, save=save).start()
    yield server
    server.stop()
    server._thread.join(30)
    assert not server.is_running


@pytest.fixture
def live(server, page):
    page.goto(server.address, timeout=30_000 * SLOW, wait_until="commit")
    until(page, "window.dancediff?.live?.pieces.length > 0", 20 * SLOW)
    return page


def play(page):
    page.locator("#play").click()
    until(page, "window.dancediff.state().time > 0.3", 10 * SLOW)


def until_changed(page, still, seconds):
    """Wait until the stage shows something else than it did."""
    end = time.monotonic() + seconds
    while not changed(still, picture(page, "#stage")) > 0.0005:
        assert time.monotonic() < end, f"in {seconds:g} s nobody moved"
        page.wait_for_timeout(200)


def test_it_appears_and_plays_while_it_is_made(live, server):
    still = picture(live, "#stage")
    assert num_colors(still) > 200
    play(live)
    until(live, f"{LIVE}.pieces.length > 4", 30 * SLOW)  # later ones come as it plays
    assert 0.001 < changed(still, picture(live, "#stage")) < 0.6
    assert live.evaluate(f"{LIVE}.ready()") > 0 and server.session.at > 0
    until(live, "document.getElementById('ahead').innerText.includes('s ahead')", 20 * SLOW)
    assert live.complaints == []
    assert {url.split("/")[2] for url in live.asked if "//" in url} == {server.host}


def test_sound_and_picture_are_in_step(live, server):
    play(live)
    off = live.evaluate(
        """async (seconds) => {
          const { audio, state } = window.dancediff, off = [];
          const end = performance.now() + 1000 * seconds;
          while (performance.now() < end) {
            // asked for after the player's own, so that it follows the drawing of the same frame
            off.push(await new Promise((go) => requestAnimationFrame(() => {
              go(audio.paused ? null : Math.abs(audio.currentTime - state().drawn));
            })));
          }
          return off.filter((seconds) => seconds !== null);
        }""",
        FOLLOWED,
    )
    off.sort()
    assert len(off) > 4 * FOLLOWED / SLOW
    assert off[len(off) // 2] < 0.05
    assert off[int(0.95 * len(off))] < 0.05 * SLOW  # a picture is late where it is drawn slowly
    if SLOW == 1:  # a busy computer may stall
        assert live.evaluate(f"{LIVE}.stalls") == server.session.stalls == 0


def test_a_knob_is_obeyed_at_the_next_segment(live, server):
    until(live, f"{LIVE}.ready() > 5", 20 * SLOW)
    live.locator("#swap").select_option(label="1 0")
    until(live, f"{LIVE}.knobs.length > 0", 20 * SLOW)
    knob = live.evaluate(f"{LIVE}.knobs[0]")
    assert knob["set"] == {"swap": [1, 0]}
    assert knob["from"] == server.session.stream.log["calls"][0]["piece"] * 2.5
    live.locator("#energy").fill("0.5")  # is a change; a second one would be told later
    until(live, f"{LIVE}.knobs.length > 1", 20 * SLOW)
    assert server.session.stream.request.energy == 0.5
    live.evaluate(f"{LIVE}.send({{set: {{energy: 'loud'}}}})")
    until(live, "document.getElementById('said').textContent.includes('energy=')")


def test_it_goes_where_the_slider_goes(live, server):
    play(live)
    live.evaluate(
        "() => { const s = document.getElementById('time'); s.value = 1200;"
        " s.dispatchEvent(new Event('input')); }"
    )
    until(live, f"{LIVE}.pieces.some((p) => p.start === 1200)", 30 * SLOW)
    until(live, "window.dancediff.state().time > 40.5", 30 * SLOW)
    assert [call["seek"] for call in server.session.stream.log["calls"]] == [40.0]


def test_a_dance_that_waits_can_be_paused(live, server):
    play(live)
    server.session.stop()  # so that nothing is danced there
    live.evaluate("window.dancediff.clock.seek(50)")
    waits = "document.getElementById('ahead').innerText.includes('waiting for the dance')"
    for expected in (True, False, True):
        until(live, f"{waits} === {str(expected).lower()}", 10 * SLOW)
        live.wait_for_timeout(500)
        assert live.evaluate(waits) == expected
        assert ("Pause" in live.locator("#play").inner_text()) == expected
        live.keyboard.press("Space")


def test_where_it_has_jumped_to_there_is_no_trail_yet(live):
    live.evaluate("window.dancediff.clock.seek(40)")
    until(live, f"{LIVE}.pieces.some((p) => p.start === 1200)", 30 * SLOW)
    live.wait_for_timeout(1000)
    with_trails = picture(live, "#stage")
    live.evaluate("document.getElementById('trails').click()")
    live.wait_for_timeout(1000)
    assert changed(with_trails, picture(live, "#stage")) == 0


def test_in_a_notebook_it_does_not_take_the_keys(server, page):
    page.set_content(f'<input id="cell"><iframe src="{server.address}"></iframe>')
    page.locator("#cell").focus()
    until(page, "document.querySelector('iframe') !== null && frames.length === 1")
    frame = page.frames[1]
    until(frame, "window.dancediff?.live?.pieces.length > 0", 20 * SLOW)
    assert page.evaluate("document.activeElement.id") == "cell"


def test_what_was_danced_is_saved(live, tmp_path):
    live.locator("#save").click()
    until(live, "document.getElementById('said').textContent.startsWith('Saved')", 20 * SLOW)
    assert (tmp_path / "dance.npz").exists() and (tmp_path / "log.json").exists()


def test_a_dance_that_was_not_saved_is_asked_about(live, server):
    """And who saves after the end is told, and does not wait."""
    leave = "window.dispatchEvent(new Event('beforeunload', { cancelable: true }))"
    assert not live.evaluate(leave)  # the browser asks
    server.stop()
    until(live, f"{LIVE}.closed", 20 * SLOW)
    live.locator("#save").click()
    assert "nothing can be saved any more" in live.locator("#said").inner_text()
    assert live.evaluate(leave)


def test_a_closed_tab_ends_the_work(server, new_page):
    page = new_page()
    page.goto(server.address, timeout=30_000 * SLOW, wait_until="commit")
    until(page, "window.dancediff?.live?.pieces.length > 0", 20 * SLOW)
    page.close()
    end = time.monotonic() + 10 * SLOW
    while server.is_running or server.session.is_running:
        assert time.monotonic() < end
        time.sleep(0.05)


def status(url, **headers):
    try:
        return urlopen(Request(url, headers=headers), timeout=10).status
    except HTTPError as error:
        return error.code


def joins(server, **headers) -> int:
    """The status with which a websocket is refused; 101 where it is not."""
    from tornado.httpclient import HTTPClientError, HTTPRequest
    from tornado.websocket import websocket_connect

    async def join():
        request = HTTPRequest(f"ws://{server.host}/session", headers=headers)
        try:
            (await websocket_connect(request)).close()
        except HTTPClientError as error:
            return error.code
        return 101

    with ThreadPoolExecutor(1) as pool:  # this thread has a loop, which is the browser's
        return pool.submit(asyncio.run, join()).result()


def test_others_are_refused(live, server, new_page):
    ours = server.address.rstrip("/")
    assert joins(server, Origin=ours) == 409  # a second client
    assert status(server.address) == 409
    assert joins(server, Origin="http://example.org") == 403
    for path in ("", "song.wav", "session"):
        assert status(server.address + path, Host="example.org") == 403
        assert status(server.address + path, Origin="http://example.org") == 403
    assert status(server.address + "song.wav", Range="bytes=99999999999-") == 416
    assert live.evaluate(f"{LIVE}.closed") is False  # the first one is undisturbed


def test_nobody_else_can_reach_it(server):
    import socket

    others = {info[4][0] for info in socket.getaddrinfo(socket.gethostname(), None, socket.AF_INET)}
    others.add("127.0.0.2")  # is this computer, too, on Linux; there may be no other address
    for other in others - {"127.0.0.1"}:
        with pytest.raises(OSError):
            socket.create_connection((other, server.port), timeout=2).close()


def test_a_dance_to_sound_in_the_room_follows_its_clock(model, song, page, nobody_leaves):
    """The page plays no sound; the picture is where the sound is, and pieces come in time."""
    room = LiveSong(played(song), song.rate, seconds=40.0, keep=True)
    server = LiveServer(model, room, dancers=2, steps=2, seed=1).start()
    try:
        page.goto(server.address, timeout=30_000 * SLOW, wait_until="commit")
        until(page, "window.dancediff?.live?.pieces.length > 2", 60 * SLOW)
        assert page.evaluate("window.dancediff.audio ?? null") is None
        still = picture(page, "#stage")
        off = abs(page.evaluate("window.dancediff.state().time") - room.now)
        assert off < 3.0 * SLOW  # it is put right with every piece, every 2.5 s
        until(page, f"window.dancediff.state().time > {room.now + 1}", 20 * SLOW)
        until_changed(page, still, 20 * SLOW)
        page.locator("#play").click()
        paused = page.evaluate("window.dancediff.state().time")
        until(
            page, f"{LIVE}.pieces.length > {page.evaluate(f'{LIVE}.pieces.length') + 1}", 60 * SLOW
        )
        assert page.evaluate("window.dancediff.state().time") == paused
        assert not [url for url in page.asked if url.endswith("song.wav")]
        assert page.complaints == []
    finally:
        server.stop()
        server._thread.join(30)
    assert not server.is_running
