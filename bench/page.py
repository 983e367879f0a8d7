"""The results page in Chromium without a window: size, time to the first paint, frames a second of the player.

Needs ``pip install "motion-gym[page]"`` and Chromium; without them it prints a line that says so.
"""

import shutil
import statistics
import tempfile
import time
from pathlib import Path

from machine import machine

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "chrome")
PAINT = "() => performance.getEntriesByName('first-contentful-paint')[0]?.startTime ?? null"
FRAMES = """(seconds) => new Promise((done) => { let frames = 0; const start = performance.now();
  const count = (now) => { frames++; if (now - start < seconds * 1000) requestAnimationFrame(count);
                           else done(frames / (now - start) * 1000); };
  requestAnimationFrame(count); })"""


def main():
    print(f"The results page. {machine()}")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    try:
        from playwright.sync_api import sync_playwright
    except ImportError:
        program = None
    if program is None:
        print('not measured: it needs Chromium and pip install "motion-gym[page]"')
        return
    from motion_gym.benchmarks.page import page, scenes

    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        path = Path(folder) / "results.html"
        start = time.perf_counter()
        page.write(path, None, scenes.read(None))
        print(f"written in {time.perf_counter() - start:.1f} s, {path.stat().st_size / 1e6:.2f} MB")
        browser = playwright.chromium.launch(executable_path=program, args=["--no-sandbox"])
        paints = []
        for _ in range(5):
            tab = browser.new_page(viewport={"width": 1300, "height": 900})
            tab.goto(path.as_uri())
            tab.wait_for_timeout(300)
            paints.append(tab.evaluate(PAINT))
            tab.close()
        print(f"first paint from a file: {statistics.median(paints):.0f} ms, the median of {len(paints)}")
        tab = browser.new_page(viewport={"width": 1300, "height": 900})
        tab.goto(path.as_uri() + "#scenes")
        for label in ("Two agents", "Crowds of ten", "Traffic", "Streams"):
            tab.select_option(
                "#scene", tab.locator(f"#scene optgroup[label^='{label}'] option").first.get_attribute("value")
            )
            tab.get_by_role("button", name="Play or pause").click()
            print(f"player, {label.lower()}: {tab.evaluate(FRAMES, 2):.0f} frames a second")
            tab.wait_for_timeout(100)
        browser.close()


if __name__ == "__main__":
    main()
