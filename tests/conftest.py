import os
import shutil
from collections import Counter
from pathlib import Path

import pytest
import torch

from places import ROOT

BROWSER_REQUIRED = "browser" in os.environ.get("DANCEDIFF_REQUIRE", "")
BROWSER_FLAGS = [
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--autoplay-policy=no-user-gesture-required",
]


@pytest.fixture(autouse=True)
def _seed():
    torch.manual_seed(0)


@pytest.fixture(scope="session")
def real_data() -> Path:
    """Folder of real songs and motion; see docs for where to get them."""
    folder = Path(os.environ.get("DANCEDIFF_DATA", ROOT.parent / "shared" / "data"))
    if not folder.is_dir():
        pytest.skip(f"no real data: {folder} does not exist; set DANCEDIFF_DATA")
    return folder


@pytest.fixture(scope="session")
def chromium():
    """Debian's chromium, driven by Playwright; without it a test is skipped."""
    path = shutil.which("chromium")
    if path is None and not BROWSER_REQUIRED:
        pytest.skip("needs a browser: apt-get install chromium")
    assert path, "chromium is required here and is not installed"
    if not BROWSER_REQUIRED:
        pytest.importorskip("playwright", reason='needs pip install "dancediff[dev]"')
    from playwright.sync_api import sync_playwright

    with sync_playwright() as play:
        browser = play.chromium.launch(executable_path=path, args=BROWSER_FLAGS)
        yield browser
        browser.close()


@pytest.fixture(scope="session")
def new_page(chromium):
    """Opens pages that remember what they complained about, asked for, and sent by websocket."""

    def listen(socket, page):
        def sent(frame):  # Playwright takes no built-in function
            page.sent.append(frame)

        socket.on("framesent", sent)

    def new(width=900, height=600):
        page = chromium.new_page(viewport={"width": width, "height": height})
        page.complaints, page.asked, page.sent = [], [], []
        page.on("console", lambda m: m.type == "error" and page.complaints.append(m.text))
        page.on("pageerror", lambda error: page.complaints.append(str(error)))
        page.on("request", lambda request: page.asked.append(request.url))
        page.on("websocket", lambda socket: listen(socket, page))
        return page

    return new


@pytest.fixture
def page(new_page):
    page = new_page()
    yield page
    page.close()


def pytest_terminal_summary(terminalreporter):
    """What `make trust` is asked for: how much was tried, and that nothing was lost."""
    if os.environ.get("DANCEDIFF_TRUST") != "long":
        return
    reports = [r for kind in ("passed", "failed") for r in terminalreporter.stats.get(kind, [])]
    facts = [v for r in reports for key, v in r.user_properties if key == "trust"]
    passed = Counter(
        r.nodeid.split("::")[0]
        for r in terminalreporter.stats.get("passed", [])
        if "trust" not in dict(r.user_properties)
    )
    facts += [f"{file}: {tests} passed" for file, tests in passed.items()]
    terminalreporter.section("trust")
    terminalreporter.write_line("\n".join(sorted(facts)))
