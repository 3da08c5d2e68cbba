"""The HTML player, from disk: plays in step, scrubs, obeys keys, compares, asks for nothing.

The browser is Debian's chromium, driven by Playwright; without it these tests are skipped.
"""

import re

import chromium_page
import pytest
from chromium_page import changed, num_colors, until

from dancediff.data.choreographer import choreograph
from dancediff.music.synth import synth_song
from dancediff.viz.gallery import save_gallery
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
    noise = re.sub(r'(?<="data:audio/mpeg;base64,)[^"]*', "AAAA", one.read_text(encoding="utf-8"))
    (folder / "noise.html").write_text(noise, encoding="utf-8")
    return {"one": one, "two": two, "mute": mute, "noise": folder / "noise.html"}


@pytest.fixture(scope="module")
def feet():
    """Foot contacts of the first dance, (dancer, frame, 4)."""
    _, truth = synth_song(3, seconds=SECONDS)
    return choreograph(truth.beats, dancers=3, seed=0, seconds=SECONDS)[0].contacts() > 0.5


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


def test_controls_keep_their_own_keys(page, files):
    show(page, files["mute"])
    page.locator("#loop").focus()
    page.keyboard.press("Space")
    assert page.locator("#loop").is_checked() and not state(page)["playing"]
    page.locator("#top").focus()
    page.keyboard.press("Space")
    assert page.locator("#top").get_attribute("aria-pressed") == "true"
    assert not state(page)["playing"]
    page.keyboard.press("ArrowRight")  # of no use to a button
    assert state(page)["frame"] == 30
    # the slider follows with the next picture
    until(page, "document.getElementById('time').value === '30'")
    page.locator("#time").focus()
    page.keyboard.press("ArrowRight")
    assert state(page)["frame"] == 31
    page.locator("#speed").focus()
    page.keyboard.press("ArrowDown")
    assert page.evaluate("document.activeElement.id") == "speed"  # the next one is a key away
    page.locator("#time").click(position={"x": 30, "y": 5})
    assert page.evaluate("document.activeElement === document.body")  # keys are the player's again


def test_keys_work_with_capslock_too(page, files):
    show(page, files["mute"])
    page.keyboard.press("T")
    assert page.locator("#top").get_attribute("aria-pressed") == "true"


def test_a_frame_is_stepped_from_the_one_that_is_seen(page, files):
    show(page, files["mute"])
    for key, frame in ((".", 11), (",", 9)):
        page.evaluate("window.dancediff.clock.seek(10.9 / 30)")
        page.keyboard.press(key)
        assert state(page)["frame"] == frame


@pytest.mark.parametrize("name", ["one", "mute"])
def test_play_in_the_last_frame_begins_anew(page, files, name):
    show(page, files[name])
    page.evaluate("window.dancediff.clock.seek(1e9)")
    page.wait_for_timeout(500)
    assert state(page)["frame"] == 30 * SECONDS - 1
    begun = page.evaluate(
        "() => { window.dancediff.clock.toggle(); return window.dancediff.state().frame; }"
    )
    assert begun < 5


def test_feet_are_those_of_the_frame_that_is_named(page, files, feet):
    """In floating point a frame's time may be a little before it: 31 / 30 * 30 is less than 31."""
    early = [k for k in range(1, feet.shape[1]) if k / 30 * 30 < k]
    frame = max(early, key=lambda k: (feet[:, k] != feet[:, k - 1]).sum())
    assert (feet[:, frame] != feet[:, frame - 1]).any()
    show(page, files["mute"])
    page.keyboard.press("c")
    seen = []
    for time in (frame / 30, (frame + 0.002) / 30, (frame - 0.002) / 30):
        page.evaluate(f"window.dancediff.clock.seek({time})")
        page.wait_for_timeout(500)
        seen.append(picture(page))
    assert changed(seen[0], seen[1]) < changed(seen[0], seen[2])


def test_the_slider_is_where_the_dance_is_also_with_the_focus(page, files):
    show(page, files["mute"])
    page.locator("#time").focus()
    page.keyboard.press(".")
    page.wait_for_timeout(300)
    assert page.locator("#time").input_value() == "1"


def test_strokes_stand_over_the_handle(page, tmp_path):
    dance = choreograph([0.5], dancers=1, seed=1, seconds=0.5)[0]
    show(page, save_player(dance, tmp_path / "short.html", metrics=False))
    drawn, wide = page.evaluate(
        f"""() => {{
          window.dancediff.data.beats = [{(dance.num_frames - 1) / 30}];
          window.dancediff.drawTicks();
          const ticks = document.getElementById("ticks");
          const row = ticks.getContext("2d").getImageData(0, 0, ticks.width, 1).data;
          return [[...Array(ticks.width).keys()].filter((x) => row[4 * x + 3]), ticks.width];
        }}"""
    )
    assert abs(sum(drawn) / len(drawn) + 0.5 - (wide - 8)) <= 1  # half a handle from the end


def test_a_sound_that_cannot_be_decoded_is_left_out(page, files):
    show(page, files["noise"])
    until(page, "window.dancediff.audio === null")
    page.keyboard.press("Space")
    until(page, "window.dancediff.state().time > 0.5")
    assert state(page)["playing"]


def test_a_reload_dances_as_fast_as_the_list_says(page, files):
    show(page, files["one"])
    page.locator("#speed").select_option("2")
    page.reload()
    until(page, "window.dancediff !== undefined")
    speed = float(page.locator("#speed").input_value())
    assert page.evaluate("window.dancediff.audio.playbackRate") == speed == 1
    assert page.locator("#speed").get_attribute("autocomplete") == "off"  # Firefox would keep it


def test_keys_work_on_a_keyboard_of_other_letters(page, files):
    show(page, files["mute"])

    def press(key, code):
        page.evaluate(
            "(keys) => document.dispatchEvent(new KeyboardEvent('keydown', keys))",
            {"key": key, "code": code},
        )

    press("\u0435", "KeyT")  # Russian
    assert page.locator("#top").get_attribute("aria-pressed") == "true"
    press("\u044e", "Period")
    assert state(page)["frame"] == 1
    press("y", "KeyT")  # Dvorak, which has Latin letters of its own
    assert page.locator("#top").get_attribute("aria-pressed") == "true"


def test_nothing_is_drawn_where_nothing_has_changed(page, files):
    page.add_init_script(
        "window.draws = 0; const draw = WebGL2RenderingContext.prototype.drawElements;"
        "WebGL2RenderingContext.prototype.drawElements = function (...what) {"
        " window.draws++; return draw.apply(this, what); }"
    )
    show(page, files["mute"])
    page.evaluate(
        "() => { window.texts = 0; new MutationObserver((all) => (window.texts += all.length))"
        ".observe(document.body, { subtree: true, childList: true }); window.draws = 0; }"
    )
    page.wait_for_timeout(1000)
    assert page.evaluate("[window.draws, window.texts]") == [0, 0]
    page.evaluate("window.dancediff.clock.seek(1)")
    until(page, "window.draws > 0 && window.texts > 0")


def test_in_a_narrow_window_all_dancers_are_seen(new_page, files):
    page = new_page(300, 700)
    show(page, files["mute"])
    page.keyboard.press("r")  # no trails
    page.wait_for_timeout(500)
    sides = picture(page)[:, [0, 1, -2, -1]]
    colorful = (sides.max(-1) - sides.min(-1)) > 60
    page.close()
    assert not colorful.any()


def test_the_tab_has_the_name_of_the_dance(page, files):
    show(page, files["mute"])
    assert page.title() == "3 dancers"


def test_without_webgl_the_page_says_so(page, files):
    page.add_init_script(
        "const get = HTMLCanvasElement.prototype.getContext;"
        "HTMLCanvasElement.prototype.getContext = function (kind, ...more) {"
        " return kind === '2d' ? get.call(this, kind, ...more) : null; }"
    )
    page.goto(files["mute"].as_uri())
    assert "has no WebGL" in page.locator("#clock").inner_text()


def test_a_gallery_is_sorted_by_keyboard(page, tmp_path):
    for name, seconds in (("b10", 3), ("b9", 4), ("a", 2)):
        dance = choreograph([0.5, 1.0, 1.5], dancers=1, seed=len(name), seconds=seconds)[0]
        (tmp_path / "in").mkdir(exist_ok=True)
        dance.save(tmp_path / "in" / f"{name}.npz")
    (tmp_path / "in" / "c.npz").write_bytes(b"no dance")
    page.goto(save_gallery(tmp_path / "in", tmp_path / "out").index.as_uri())

    def names():
        return [cell.split(".npz")[0] for cell in page.locator("td:first-child").all_inner_texts()]

    page.get_by_role("button", name="dance").focus()
    page.keyboard.press("Enter")
    assert names() == ["a", "b9", "b10", "c"]
    page.keyboard.press("Enter")
    assert names() == ["c", "b10", "b9", "a"]
    assert page.locator("th").first.get_attribute("aria-sort") == "descending"
    page.get_by_role("button", name="PFC").click()
    values = page.locator("tr:has(td.n) td:nth-child(6)").evaluate_all(
        "cells => cells.map((cell) => Number(cell.dataset.v))"
    )
    assert values == sorted(values, reverse=True) and names()[-1] == "c"
    assert page.locator("[aria-sort]").count() == 1
