"""A real browser: Debian's chromium, driven by Playwright. Without it these tests are skipped."""

import os
import shutil

import pytest

REQUIRED = "browser" in os.environ.get("DANCEDIFF_REQUIRE", "")
FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--autoplay-policy=no-user-gesture-required",
]


@pytest.fixture(scope="session")
def chromium():
    path = shutil.which("chromium")
    if path is None and not REQUIRED:
        pytest.skip("needs a browser: apt-get install chromium")
    assert path, "chromium is required here and is not installed"
    if not REQUIRED:
        pytest.importorskip("playwright", reason='needs pip install "dancediff[dev]"')
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=path, args=FLAGS)
        yield browser
        browser.close()


@pytest.fixture
def page(chromium):
    """A page that remembers what it complained about, and what it asked for."""
    page = chromium.new_page(viewport={"width": 900, "height": 600})
    page.complaints, page.asked = [], []
    page.on("console", lambda m: m.type == "error" and page.complaints.append(m.text))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.on("request", lambda request: page.asked.append(request.url))
    yield page
    page.close()
