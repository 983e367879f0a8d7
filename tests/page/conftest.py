"""The results page in a real browser without a window."""

import shutil

import pytest
from playwright.sync_api import sync_playwright

from motion_gym.benchmarks.page import page as results_page
from motion_gym.benchmarks.page import scenes as scene_file

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")


@pytest.fixture(scope="session")
def address(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "results.html"
    results_page.write(path, None, scene_file.read(None))
    return path.as_uri()


@pytest.fixture(scope="session")
def browser():
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.fail(f"No browser: install Chromium, so that one of {', '.join(BROWSERS)} is found.")
    with sync_playwright() as playwright:
        yield playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])


@pytest.fixture
def tab(browser):
    """A tab that fails on messages of the console and on requests to a network."""
    problems = []
    context = browser.new_context(viewport={"width": 1300, "height": 900})
    tab = context.new_page()
    tab.on("console", lambda message: problems.append(message.text) if message.type in ("error", "warning") else None)
    tab.on("pageerror", lambda error: problems.append(str(error)))
    tab.on(
        "request", lambda request: None if request.url.startswith(("file:", "data:")) else problems.append(request.url)
    )
    yield tab
    context.close()
    assert problems == []
