"""The results page: player, leaderboard, curves, keyboard, print, addresses and accessibility."""

import pytest
from axe_playwright_python.sync_playwright import Axe

from motion_gym.benchmarks import running

NUMBER_OF_STEP = "() => Number(document.querySelector('#player input[type=range]').value)"
INK = """() => { const c = document.getElementById('stage'), copy = new OffscreenCanvas(c.width, c.height);
  const context = copy.getContext('2d', {willReadFrequently: true}); context.drawImage(c, 0, 0);
  return context.getImageData(0, 0, c.width, c.height).data.filter((value, i) => i % 4 === 3 && value).length; }"""


def wait_until(tab, condition):
    """Ask again and again; the page's own rules forbid the function of the tab that does so."""
    for _ in range(100):
        if condition():
            return
        tab.wait_for_timeout(50)
    pytest.fail("it did not happen within 5 seconds")


@pytest.mark.parametrize("view", ["scenes", "leaderboard", *running.BENCHMARKS])
def test_each_view_is_shown_alone(tab, address, view):
    tab.goto(f"{address}#{view}")
    assert tab.locator(".view:visible").count() == 1
    assert tab.locator(f"#{view}:visible").count() == 1
    assert tab.locator("nav a[aria-current]").get_attribute("href") == f"#{view}"
    tab.wait_for_timeout(100)  # curves are drawn when they come into view


def test_the_player_plays_every_scene(tab, address):
    tab.goto(f"{address}#scenes")
    options = tab.locator("#scene option").count()
    assert options >= 50
    for number in range(options):
        tab.select_option("#scene", str(number))
        assert tab.evaluate(INK) > 200
    tab.select_option("#scene", "0")
    before = tab.evaluate(NUMBER_OF_STEP)
    tab.get_by_role("button", name="Play or pause").click()
    wait_until(tab, lambda: tab.evaluate(NUMBER_OF_STEP) > before + 2)
    tab.get_by_role("button", name="Play or pause").click()
    held = tab.evaluate(NUMBER_OF_STEP)
    tab.wait_for_timeout(400)
    assert tab.evaluate(NUMBER_OF_STEP) == held


def test_a_scene_is_stepped_and_scrubbed_without_a_mouse(tab, address):
    tab.goto(f"{address}#scenes?scene=2&step=7")
    tab.locator("#stage").focus()
    tab.keyboard.press("ArrowRight")
    tab.keyboard.press("ArrowRight")
    assert tab.evaluate(NUMBER_OF_STEP) == 9
    tab.keyboard.press("ArrowLeft")
    assert tab.evaluate(NUMBER_OF_STEP) == 8
    tab.locator("#player input[type=range]").focus()
    tab.keyboard.press("End")
    assert tab.evaluate(NUMBER_OF_STEP) == 19
    assert "step=19" in tab.url and "scene=2" in tab.url
    assert "Step 20 of 20" in tab.locator("#status").inner_text()


def test_an_address_leads_to_a_scene_and_its_hidden_methods(tab, address):
    tab.goto(f"{address}#scenes?scene=3&step=12&hide=constant_velocity")
    assert tab.locator("#scene").input_value() == "3"
    assert tab.evaluate(NUMBER_OF_STEP) == 12
    boxes = tab.locator("#player fieldset input")
    assert [boxes.nth(i).is_checked() for i in range(3)] == [False, True, True]


def test_a_stream_shows_its_shift_and_what_was_learned(tab, address):
    tab.goto(f"{address}#scenes")
    streams = tab.locator("#scene optgroup[label^=Streams] option")
    tab.select_option("#scene", streams.nth(0).get_attribute("value"))
    first = tab.locator("#gauges meter").first.get_attribute("value")
    tab.locator("#player input[type=range]").focus()
    tab.keyboard.press("End")
    assert "after:" in tab.locator("#status").inner_text()
    assert tab.locator("#gauges meter").first.get_attribute("value") != first


def test_the_leaderboard_sorts_by_mouse_and_keyboard(tab, address):
    tab.goto(f"{address}#leaderboard?benchmark=style")
    heading = tab.locator("#board thead th", has_text="ADE").first
    column = heading.evaluate("th => th.cellIndex")

    def values():
        cells = f"() => [...document.querySelectorAll('#board tbody tr')].map(tr => tr.cells[{column}].dataset.sort)"
        return [float(value) for value in tab.evaluate(cells)]

    heading.click()
    wait_until(tab, lambda: heading.get_attribute("aria-sort") == "ascending" and values() == sorted(values()))
    assert len(values()) > 50
    heading.focus()
    tab.keyboard.press("Enter")
    wait_until(tab, lambda: values() == sorted(values(), reverse=True))


def test_filters_and_search_are_in_the_address(tab, address):
    tab.goto(f"{address}#leaderboard?benchmark=places")
    all_rows = tab.locator("#board tbody tr").count()
    tab.select_option("[data-filter=column]", "hotel")
    tab.fill("[data-filter=q]", "kalman")
    shown = tab.locator("#board tbody tr").count()
    assert 0 < shown < all_rows
    assert all("kalman" in text for text in tab.locator("#board tbody th").all_inner_texts())
    tab.goto(tab.url)
    tab.reload()
    assert tab.locator("#board tbody tr").count() == shown
    assert tab.locator("[data-filter=q]").input_value() == "kalman"


def test_a_score_shows_its_conditions(tab, address):
    tab.goto(f"{address}#leaderboard?benchmark=places&column=eth&q=kalman_residual")
    tab.locator("#board button").first.focus()
    tab.keyboard.press("Enter")
    text = tab.locator("#conditions").inner_text()
    for part in ("protocol honest", "k = 20", "unit m", "agent-windows", "bootstrap", "epoch"):
        assert part in text
    tab.keyboard.press("Escape")
    assert not tab.locator("#conditions").is_visible()


def test_curves_are_drawn_and_have_a_table(tab, address):
    tab.goto(f"{address}#style")
    chart = tab.locator("#style .chart").first
    chart.scroll_into_view_if_needed()
    chart.locator("canvas").wait_for()
    chart.locator("summary").click()
    assert "orca_oracle" in chart.locator("table tbody").last.inner_text()


def test_print_leaves_out_the_controls(tab, address):
    tab.goto(f"{address}#style")
    tab.emulate_media(media="print")
    assert not tab.locator("nav").is_visible()
    assert tab.locator("#style table").first.is_visible()
    assert len(tab.pdf()) > 10_000


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1300])
def test_axe_finds_no_violation(tab, address, scheme, width):
    tab.set_viewport_size({"width": width, "height": 850})
    tab.emulate_media(color_scheme=scheme)
    for view in ("scenes", "leaderboard?benchmark=places", "style", "online"):
        tab.goto(f"{address}#{view}")
        tab.wait_for_timeout(150)
        found = Axe().run(tab)
        assert found.violations_count == 0, f"{view}: {found.generate_report()}"


def test_a_phone_needs_no_sideways_scrolling(tab, address):
    tab.set_viewport_size({"width": 390, "height": 850})
    for view in ("scenes", "leaderboard", "style"):
        tab.goto(f"{address}#{view}")
        assert tab.evaluate("() => document.documentElement.scrollWidth") <= 390
