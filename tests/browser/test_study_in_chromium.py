"""The page of a user study, from disk: rated by keys, answers downloaded, then scored.

The browser is Debian's chromium, driven by Playwright; without it these tests are skipped.
"""

import base64
import io
import json

import numpy as np
import pytest
from chromium_page import SLOW, num_colors, until
from PIL import Image

from dancediff.data.choreographer import choreograph
from dancediff.music.synth import synth_song
from dancediff.user_study.make import study
from dancediff.user_study.scores import score_study

SECONDS = 3.0
SONGS = 3


pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A study of three songs: dances of "good" against those of "bad"."""
    folder, songs = tmp_path_factory.mktemp("study"), []
    for k in range(SONGS):
        song, truth = synth_song(k, seconds=SECONDS)
        songs.append(song.save(folder / f"song{k}.wav"))
        for name, seed in (("good", 1), ("bad", 2)):
            dance = choreograph(truth.beats, dancers=2, seed=10 * k + seed, seconds=SECONDS)[0]
            (folder / name / f"song{k}").mkdir(parents=True)
            dance.save(folder / name / f"song{k}" / "dance.npz")
    return study(folder / "good", folder / "bad", out=folder / "s.html", songs=songs, seed=3)


def begin(page, made, rater):
    page.goto(made.page.as_uri())
    page.locator("#rater").fill(rater)
    page.keyboard.press("Enter")
    wait_for_player(page)


def wait_for_player(page):
    until(page, "window.study.ready()", 20 * SLOW)  # before, no second that is watched counts
    page.wait_for_timeout(300)


def shown(page):
    """The id of the pair on the page."""
    return page.evaluate("(s => read('study').pairs[s.at])(window.study.state())")


def drawn(page):
    """What the player in the frame has drawn, (height, width, 3)."""
    url = page.evaluate(
        "document.getElementById('stage').contentDocument.getElementById('stage').toDataURL()"
    )
    image = Image.open(io.BytesIO(base64.b64decode(url.partition(",")[2])))
    return np.asarray(image.convert("RGB")).astype(int)


def download(page):
    with page.expect_download() as waiting:
        page.locator("#download").click()
    return waiting.value


def test_a_study_is_rated_by_keys_and_scored(page, made, tmp_path):
    key = json.loads(made.key.read_text())["pairs"]
    begin(page, made, "Ada L.")
    for at in range(SONGS):
        id = shown(page)
        assert page.locator("#where").inner_text() == f"Pair {at + 1} of {SONGS}"
        assert page.locator("#next").is_disabled()
        page.keyboard.press("q")  # too early: it does not count
        assert page.evaluate("Object.keys(window.study.state().answers).length") == at
        page.keyboard.press("Space")
        until(page, "window.study.open()", 20 * SLOW)
        page.keyboard.press("Space")
        good, bad = ("q", "p") if key[id]["left"] == "good" else ("p", "q")
        for press in (good, good, bad, good):
            page.keyboard.press(press)
        page.keyboard.press("ArrowUp")  # back to the third question, and changed
        page.keyboard.press(good if at else bad)
        page.keyboard.press("Enter")
        if at < SONGS - 1:
            wait_for_player(page)
    answers = download(page)
    assert answers.suggested_filename.startswith("answers_Ada-L-_")
    answers.save_as(tmp_path / "answers.json")
    scores = score_study([tmp_path / "answers.json"], made.key)
    values = {score.question: (score.rate.value, score.rate.votes) for score in scores.scores}
    assert values == {
        "motion realism": (1.0, 3),
        "music-motion correlation": (1.0, 3),
        "formation aesthetics": (pytest.approx(2 / 3), 3),
        "harmony of dancers": (1.0, 3),
    }
    assert page.complaints == []
    local = ("file:", "data:", "about:", "blob:")
    assert [url for url in page.asked if not url.startswith(local)] == []


def test_a_reload_loses_nothing_and_somebody_else_begins_anew(page, made):
    begin(page, made, "Ada")
    both = drawn(page)
    half = both.shape[1] // 2
    assert num_colors(both[:, :half]) > 200 < num_colors(both[:, -half:])  # no blank stage
    page.keyboard.press("Space")
    until(page, "window.study.open()", 20 * SLOW)
    page.keyboard.press("p")
    state = page.evaluate("window.study.state()")
    assert list(state["answers"].values()) == [{"motion realism": "right"}]
    page.reload()
    page.get_by_text("Go on as Ada").click()
    wait_for_player(page)
    again = page.evaluate("window.study.state()")
    assert (again["token"], again["answers"]) == (state["token"], state["answers"])
    page.locator("#stop").click()
    assert "1 of 12 votes" in page.locator("#said").inner_text()
    assert page.locator("#fresh").is_disabled()  # it would throw the answers away
    download(page)
    page.get_by_text("Somebody else begins").click()
    page.locator("#rater").fill("Ada")  # of the same name
    page.keyboard.press("Enter")
    fresh = page.evaluate("window.study.state()")
    assert fresh["answers"] == {} and fresh["token"] != state["token"]


def test_answers_that_were_not_downloaded_are_not_thrown_away_unasked(page, made):
    begin(page, made, "Ada")
    page.keyboard.press("Space")
    until(page, "window.study.open()", 20 * SLOW)
    page.keyboard.press("p")
    page.goto(made.page.as_uri())
    asked = []
    page.once("dialog", lambda dialog: (asked.append(dialog.message), dialog.dismiss()))
    page.locator("#rater").fill("Bob")
    page.keyboard.press("Enter")
    assert asked == ["The answers of Ada were not downloaded. Throw them away?"]
    assert page.locator("#start").is_visible()
    page.get_by_text("Go on as Ada").click()
    wait_for_player(page)
    page.locator("#stop").click()
    download(page)
    page.locator("#again").click()  # downloaded already: nobody is asked
    page.goto(made.page.as_uri())
    page.locator("#rater").fill("Bob")
    page.keyboard.press("Enter")
    wait_for_player(page)
    assert page.evaluate("window.study.state()")["rater"] == "Bob" and len(asked) == 1


def test_a_focused_button_is_what_enter_and_space_press(page, made):
    begin(page, made, "Ada")
    page.keyboard.press("Space")
    until(page, "window.study.open()", 20 * SLOW)
    until(page, "!player().clock.playing()", 20 * SLOW)  # it has come to its end
    page.locator("#votes button").nth(1).focus()
    page.keyboard.press("Space")
    (given,) = page.evaluate("window.study.state()")["answers"].values()
    assert list(given.values()) == ["right"]
    assert not page.evaluate("player().clock.playing()")
    page.locator("#stop").focus()
    page.keyboard.press("Enter")
    assert page.locator("#end").is_visible()


def test_a_screen_reader_hears_what_has_changed_and_nothing_twice(page, made):
    begin(page, made, "Ada")
    assert "s to go" in page.locator("#hint").inner_text()
    page.evaluate(
        "() => { window.said = []; const status = $('status');"
        " new MutationObserver(() => window.said.push(status.textContent))"
        ".observe(status, { childList: true, characterData: true, subtree: true }); }"
    )
    page.keyboard.press("Space")
    until(page, "window.study.open()", 20 * SLOW)
    assert page.evaluate("window.said") == ["Q votes for the left dance, P for the right"]
    assert page.get_by_role("progressbar", name="Votes given").is_visible()
    assert page.frames[1].locator("#stage").get_attribute("role") == "img"
    active = page.locator("[aria-current='true']")
    assert active.count() == 1 and "active" in active.get_attribute("class")


def test_votes_are_given_on_a_keyboard_of_other_letters(page, made):
    begin(page, made, "Ada")
    page.keyboard.press("Space")
    until(page, "window.study.open()", 20 * SLOW)
    page.evaluate(
        "document.dispatchEvent(new KeyboardEvent('keydown', { key: '\u0439', code: 'KeyQ' }))"
    )
    (given,) = page.evaluate("window.study.state()")["answers"].values()
    assert list(given.values()) == ["left"]
