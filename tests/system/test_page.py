"""The page in headless Chromium: a plan file, one HTML file with the network off, and the live graph."""

import os
import shutil
import time

import pytest
from conftest import wait_until_up

from hmap_core import planner
from hmap_core.scenes import load_scene
from hmap_core.viewer.html_file import write_html
from hmap_core.viewer.page import Page
from hmap_core.viewer.recording import of_plan
from hmap_core.viewer.server import address, open_server

CHROMIUM = shutil.which("chromium")
LIMIT = 60e3  # ms for anything to appear on a busy machine
ARGUMENTS = ["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]
SIZE = {"width": 560, "height": 420}  # pixels; the picture is drawn without a GPU

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(
        CHROMIUM is None and "CI" not in os.environ, reason="Debian's package chromium is not installed"
    ),
]


@pytest.fixture(scope="module")
def browser():
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=ARGUMENTS)
        yield browser
        browser.close()


@pytest.fixture
def tab(browser):
    """A tab in which no error may be logged."""
    tab = browser.new_page(viewport=SIZE)
    tab.set_default_timeout(LIMIT)
    errors = []
    tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
    tab.on("pageerror", lambda error: errors.append(str(error)))
    yield tab
    tab.close()
    assert not errors


@pytest.fixture(scope="module")
def plan():
    return planner.plan(load_scene("tunnel", 0), seed=0, time_limit=120.0)


def line(tab, text: str):
    """The line of the page that has a text."""
    return tab.locator(".hmap-line", has_text=text).first


def test_a_plan_is_scrubbed_and_asked_about(tab, plan):
    page = Page(open_server(port=0))
    try:
        page.add_recording(of_plan(plan, "one"))
        page.add_recording(of_plan(plan, "two"))
        tab.goto(address(page.server))
        line(tab, "two: ").wait_for()
        assert "waypoint 1: pose 0" in tab.locator(".hmap-search").inner_text()
        set_slider(tab, "Time (s)", "5")
        line(tab, "two, 5.00 s").wait_for()
        tab.get_by_role("button", name="Refused contacts").click()
        line(tab, "a click on one says why").wait_for()
        tab.get_by_role("button", name="RRT tree").click()
        line(tab, "RRT-Connect").wait_for()
        tab.get_by_label("Beside it").first.click()
        tab.get_by_role("option", name="one").last.click()
        assert eventually(lambda: page.playback.right.plan is not None)
    finally:
        page.close()


def test_one_html_file_plays_with_the_network_off(tab, plan, tmp_path):
    write_html(of_plan(plan, "tunnel"), tmp_path / "plan.html")
    tab.context.set_offline(True)
    asked = []
    tab.on("request", lambda request: asked.append(request.url))
    tab.goto((tmp_path / "plan.html").as_uri())
    tab.locator("canvas").first.wait_for()
    clock = tab.locator("input").first
    first = clock.input_value()
    assert eventually(lambda: clock.input_value() != first)
    assert "by hand" in tab.locator(".hmap-panel").inner_html()
    assert {url.partition(":")[0] for url in asked} <= {"file", "blob", "data"}
    tab.context.set_offline(False)


def test_a_task_is_chosen_run_paused_and_cancelled(tab, graph):
    graph.start("viewer", {"port": 0})
    wait_until_up(graph, graph.session)
    log = graph.folder / "viewer.log"
    assert eventually(lambda: "page at " in log.read_text())
    tab.goto(log.read_text().rpartition("page at ")[2].split()[0])
    tab.get_by_label("Task").first.click()
    tab.get_by_role("option", name="tunnel", exact=True).click()
    seed = tab.get_by_label("Seed")
    seed.fill("3")
    seed.press("Enter")
    set_slider(tab, "Speed", "0.1")  # the simulation runs as fast as it can
    tab.get_by_role("button", name="Execute").click()
    line(tab, "execution: ").wait_for(timeout=2 * LIMIT)
    assert "waypoint 1" in tab.locator(".hmap-search").inner_text()  # before a new plan may be asked for
    tab.get_by_role("button", name="Pause").click()
    line(tab, "paused: ").wait_for()
    tab.get_by_role("button", name="Cancel").click()
    tab.locator(".hmap-line", has_text="CANCELED").nth(1).wait_for()  # as the phase, and as the result of the goal
    tab.get_by_role("button", name="Resume").click()
    line(tab, "motions go on").wait_for()
    set_slider(tab, "Speed", "1")


def set_slider(tab, label: str, value: str) -> None:
    """Type a value into the field beside a slider."""
    field = tab.get_by_text(label, exact=True).locator("xpath=ancestor::div[.//input][1]").locator("input").last
    field.fill(value)
    field.press("Enter")


def eventually(ready, limit: float = LIMIT / 1e3) -> bool:
    """Whether something becomes true within a time (s)."""
    until = time.monotonic() + limit
    while not ready():
        if time.monotonic() > until:
            return False
        time.sleep(0.05)
    return True
