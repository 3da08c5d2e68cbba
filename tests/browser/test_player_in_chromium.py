"""The HTML player, from disk: plays in step, scrubs, obeys keys, compares, asks for nothing.

The browser is Debian's chromium, driven by Playwright; without it these tests are skipped.
"""

import chromium_page
import pytest
from chromium_page import changed, num_colors, until

from dancediff.data.choreographer import choreograph
from dancediff.music.synth import synth_song
from dancediff.viz.player import save_player

SECONDS = 24.0


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("player")
    song, truth = synth_song(3, seconds=SECONDS)
    dances = [choreograph(truth.beats, dancers=3, seed=k, seconds=SECONDS)[0] for k in (0, 1)]
    one = save_player(dances[0], folder / "one.html", song, metrics=False)
    two = save_player(dances[0], folder / "two.html", song, other=dances[1], metrics=False)
    mute = save_player(dances[0], folder / "mute.html", metrics=False)
    return {"one": one, "two": two, "mute": mute}


def show(page, path):
    page.goto(path.as_uri())
    until(page, "window.dancediff !== undefined")
    page.wait_for_timeout(300)


def state(page):
    return page.evaluate("window.dancediff.state()")


def picture(page):
    return chromium_page.picture(page, "#stage")


def test_dance_and_sound_are_in_step_after_twenty_seconds(page, files):
    show(page, files["one"])
    page.keyboard.press("Space")
    until(page, "window.dancediff.audio.currentTime > 20")
    off = page.evaluate(
        "() => 30 * window.dancediff.audio.currentTime - window.dancediff.state().frame"
    )
    assert state(page)["playing"] and -1 <= off <= 1.01
    assert page.complaints == []
    assert [url for url in page.asked if not url.startswith(("file:", "data:"))] == []


def test_dancers_are_seen_and_move(page, files):
    show(page, files["one"])
    still = picture(page)
    assert num_colors(still) > 200  # no blank page
    page.evaluate("window.dancediff.clock.seek(5)")
    page.wait_for_timeout(500)
    assert 0.002 < changed(still, picture(page)) < 0.5


def test_keys_and_slider(page, files):
    show(page, files["one"])
    page.keyboard.press("ArrowRight")
    page.keyboard.press(".")
    page.wait_for_timeout(300)
    assert state(page)["frame"] == 31 and not state(page)["playing"]
    page.keyboard.press(",")
    page.keyboard.press("ArrowLeft")
    page.wait_for_timeout(300)
    assert state(page)["frame"] == 0
    page.evaluate(
        "() => { const s = document.getElementById('time'); s.value = 300;"
        " s.dispatchEvent(new Event('input')); }"
    )
    page.wait_for_timeout(500)
    assert state(page)["frame"] == 300
    front = picture(page)
    page.keyboard.press("t")
    page.wait_for_timeout(500)
    assert changed(front, picture(page)) > 0.02
    assert page.locator("#top").get_attribute("aria-pressed") == "true"


def test_two_dances_play_side_by_side(page, files):
    show(page, files["two"])
    page.evaluate("window.dancediff.clock.seek(6)")
    page.wait_for_timeout(800)
    both = picture(page)
    half = both.shape[1] // 2
    left, right = both[:, :half], both[:, -half:]
    assert changed(left, right) > 0.002  # other dances
    for side in (left, right):
        assert num_colors(side) > 200


def test_without_a_song_it_plays_by_its_own_clock(page, files):
    show(page, files["mute"])
    before = page.evaluate("performance.now()")
    page.locator("#play").click()
    page.wait_for_timeout(1500)
    page.locator("#play").click()
    stopped = state(page)
    passed = (page.evaluate("performance.now()") - before) / 1000
    assert 0.5 < stopped["time"] < passed and not stopped["playing"]
    assert page.complaints == []


def test_it_begins_again_at_the_end_every_time(page, files):
    show(page, files["one"])
    page.locator("#loop").check()
    page.keyboard.press("Space")
    for _ in range(2):
        page.evaluate(f"window.dancediff.audio.currentTime = {SECONDS - 1}")
        until(page, "window.dancediff.state().frame < 200")
        until(page, "window.dancediff.state().frame > 15")
        assert state(page)["playing"]
    page.locator("#loop").uncheck()
    page.evaluate(f"window.dancediff.audio.currentTime = {SECONDS - 1}")
    until(page, "!window.dancediff.state().playing")
    assert state(page)["frame"] > 700
